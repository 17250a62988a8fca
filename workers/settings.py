"""Settings of a farm. Built once at a process's entry (from flags, a file or the environment) and passed down; nothing
here reads the environment."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, SecretStr

from pipeline.kernels.processors import usable_processors
from pipeline.video.media import Limits


class FarmSettings(BaseModel):
    """Storage, concurrency and limits of a farm."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    home: Path = Path(".impasto")
    """Folder of the database, blobs, scratch files and locks, unless they have a place of their own."""
    database_url: str = Field(default="", repr=False)
    """`postgresql://user:password@host/name`; empty: SQLite in `home`."""
    blob_root: Path | None = None
    """Folder of blobs; None: `home`/blobs."""
    blob_url: str = Field(default="", pattern=r"^$|^s3://[a-z0-9][a-z0-9.-]{1,61}[a-z0-9](/[A-Za-z0-9._/-]*)?$")
    """`s3://bucket/prefix`: blobs are there and not in a folder."""
    reserve_bytes: int = Field(default=256 << 20, ge=0)
    """New work is refused while less than this is free on the disk of the blobs (with S3: of their local copies)."""

    s3_endpoint_url: str = ""
    """Endpoint of an S3 server other than Amazon's, such as `http://localhost:9000`."""
    s3_region: str = ""
    s3_access_key: SecretStr = SecretStr("")
    """Credentials of S3; empty: those that boto3 finds (AWS_ACCESS_KEY_ID, ~/.aws, the machine's role)."""
    s3_secret_key: SecretStr = SecretStr("")
    s3_addressing: Literal["auto", "path", "virtual"] = "auto"
    """"path": the bucket's name is not a part of the host's name."""
    s3_checksums: bool = True
    """Send CRCs with bodies and check them; off for servers that do not know them."""
    s3_part_bytes: int = Field(default=16 << 20, ge=5 << 20, le=5 << 30)
    """Larger blobs are sent in parts of this size; a server takes 10,000 parts of a blob, some only 1,000."""
    s3_direct: bool = False
    """Send downloads on to S3 by signed URLs; clients must be able to reach the endpoint."""
    cache_root: Path | None = None
    """Folder for local copies of blobs in S3; None: `home`/copies, on a Ray cluster the temporary folder."""
    cache_bytes: int = Field(default=20 << 30, ge=0)
    """Local copies of blobs above this size in total are removed when unused, bytes."""

    max_asset_bytes: int = Field(default=8 << 30, ge=1024)
    max_pixels: int = Field(default=50_000_000, ge=256)
    """Pixels of one frame."""
    max_side_px: int = Field(default=16384, ge=16)
    max_seconds: float = Field(default=2 * 3600.0, gt=0)
    max_frames: int = Field(default=1_000_000, ge=1)

    pool: Literal["local", "ray", "none"] = "local"
    """Where attempts run: in this process, on a Ray cluster, or nowhere (jobs are only accepted and shown)."""
    workers: int = Field(default=0, ge=0, le=256)
    """Attempts that run at once; 0: as many as the machine has processors and memory for."""
    role: Literal["serve", "worker"] = "serve"
    """Shown to operators: whether the process answers requests, too."""
    ray_address: str = "local"
    """"local" starts a cluster on this machine; else the address of a cluster."""

    task_cpus: float = Field(default=1.0, gt=0, le=256)
    """Processors that Ray reserves for a task, unless its plan declares another number (`Resources.cpus`)."""
    task_gpus: float = Field(default=0.0, ge=0, le=16)
    """GPUs that Ray reserves for a task that uses a compute device (0.25: four tasks share one; 0: it uses a
    processor)."""
    task_memory_bytes: int = Field(default=1 << 30, ge=0)
    """Least memory that Ray reserves for a task."""
    capacity_wait_s: float = Field(default=600.0, ge=1)
    """Time for which a task waits, because no present machine is large enough, before it fails. An autoscaler may add
    one."""

    attempts: int = Field(default=3, ge=1, le=20)
    """Failures after which a task fails permanently."""
    interruptions: int = Field(default=20, ge=1)
    """Attempts of a task that may end with their process before it fails permanently."""
    retry_delay_s: float = Field(default=0.5, ge=0)
    """Wait before the second attempt; doubles with each failure."""
    lease_s: float = Field(default=30.0, gt=0)
    """An attempt whose dispatcher (on another machine) is silent for this long is given to another."""
    stall_s: float = Field(default=45.0, gt=0)
    """An attempt that neither reports nor moves bytes for this long hangs: it is ended with its process and runs again.
    The default leaves time for frames of 3840x2160 on a busy machine."""
    warm_up: bool = True
    """Load the kernels of every method, compiling new ones, when a process starts that renders; off: at their first
    use, so that the first frame takes seconds longer and the start less work."""
    live_sessions: int = Field(default_factory=lambda: os.cpu_count() or 1, ge=0, le=1024)
    """Maximum number of live sessions at once; further ones are refused as busy. 0: none."""
    live_spares: int = Field(default=2, ge=0, le=16)
    """Warm live workers beyond those in use (Ray), so that a session starts, or continues after a crash, at once."""
    live_max_side_px: int = Field(default=1920, ge=64, le=8192)
    """Longest side of a live frame."""
    live_max_fps: float = Field(default=120.0, gt=0, le=240)
    live_frame_bytes: int = Field(default=12 << 20, ge=4096)
    """Largest payload of a live frame, bytes: 1920x1920 in raw RGB."""

    owner_tasks: int | None = Field(default=None, ge=1)
    """Maximum number of running tasks of one owner; a key may have its own limit. None: no limit."""
    sweep_s: float = Field(default=6 * 3600.0, gt=0)
    """Interval of sweeps that delete unneeded blobs, which processes leave if they crash while they delete them."""

    preview_bytes: int = Field(default=512 << 20, ge=16 << 20)
    """Maximum size of the cached frames and other state from which previews are made."""
    preview_threads: int = Field(default=2, ge=1, le=64)
    """Number of previews of projects that are made at once."""
    preview_actors: int = Field(default=2, ge=1, le=64)
    """Maximum number of processes on a Ray cluster that make previews; each has an equal part of `preview_bytes`. While
    there are no more projects than processes, each project has a process of its own."""
    preview_idle_s: float = Field(default=900.0, gt=0)
    """A preview process whose projects were all silent for this long ends (Ray)."""
    project_undo_s: float = Field(default=30 * 86400.0, ge=0)
    """A deleted project can be restored for this long."""
    project_versions_s: float = Field(default=7 * 86400.0, ge=0)
    """Time for which every version of a project is kept; after that, one version an hour and named ones."""

    reuse_s: float = Field(default=86400.0, ge=0)
    """Task results of a project's newest job of each shot are kept for this long, so that the next job repeats only
    what has changed. 0: not at all."""

    records_s: float = Field(default=366 * 86400.0, ge=0)
    """The audit trail, and what each job has cost, are kept for this long."""

    log_format: Literal["text", "json"] = "text"
    """Format of logs on stderr: text for people, or one JSON object per line."""
    log_level: Literal["debug", "info", "warning", "error"] = "warning"

    events_kept: int = Field(default=5000, ge=10)
    """Newest events kept per job."""

    @property
    def most_workers(self) -> int:
        """Maximum number of attempts that run at once."""
        return self.workers or usable_processors()

    @property
    def for_workers(self) -> FarmSettings:
        """The settings for a process that only renders: without addresses and secrets of stores."""
        return FarmSettings(home=self.home, log_format=self.log_format, log_level=self.log_level)

    @property
    def url(self) -> str:
        return self.database_url or f"sqlite:///{(self.home / 'impasto.db').absolute()}"

    @property
    def scratch(self) -> Path:
        """Folder of files that are being written; of no use once its process has ended."""
        return (self.home / "scratch").absolute()

    @property
    def limits(self) -> Limits:
        """Limits of an asset's size."""
        return Limits(
            size_bytes=self.max_asset_bytes,
            pixels=self.max_pixels,
            side_px=self.max_side_px,
            seconds=self.max_seconds,
            frames=self.max_frames,
        )

    @property
    def blobs_at(self) -> Path:
        return (self.blob_root or self.home / "blobs").absolute()

    @property
    def copies_at(self) -> Path:
        """Folder for local copies of blobs that are in S3. Other machines of a cluster may not have this home."""
        far = self.pool == "ray" and self.ray_address != "local"
        elsewhere = Path(tempfile.gettempdir()) / f"impasto-{os.getuid()}" / "copies"
        return (self.cache_root or (elsewhere if far else self.home / "copies")).absolute()
