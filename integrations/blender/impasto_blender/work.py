# SPDX-License-Identifier: GPL-3.0-or-later
"""Sends frames to a service and fetches the painted ones, in a thread of its own. Uses no Blender."""

from __future__ import annotations

import json
import re
import tempfile
import threading
import time
import zipfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from impasto_client import FINAL, BadInput, BadParameter, Cancelled, Client, ImpastoError
from impasto_client.problems import job_failed

EPOCH = (1980, 1, 1, 0, 0, 0)
_DIGITS = re.compile(r"(\d+)(?=\.[^.]+$)")


@dataclass(frozen=True)
class Order:
    """One job: the frames, the method with its parameters, and the folder of the result.

    Attributes:
        frames: rendered pictures, in order; their names end in the frame number.
        fps: frame rate, frames per second.
        inputs: input name of the method -> file, folder of pictures, or asset id ("ast_...").
        folder: the painted frames are written there as `painted.####.png` or `.exr`; files of other names stay.
        form: "png" or "exr".
        ca_file: PEM file of certificate authorities; empty: the usual ones.
    """

    server: str
    api_key: str
    frames: Sequence[Path]
    fps: float
    method: str
    params: Mapping[str, Any]
    inputs: Mapping[str, str]
    folder: Path
    form: str = "png"
    seed: int = 0
    ca_file: str = ""

    def client(self) -> Client:
        return Client(self.server, self.api_key, ca_file=self.ca_file)


@dataclass
class Painting:
    """A running order; its attributes may be read while the thread works.

    Attributes:
        said: what happens now, for the user.
        progress: share of the work that is done, 0..1.
        error: why it ended without frames; empty: it did not.
        warnings: what the service said about the job.
        painted: the painted frames, once all are there.
    """

    order: Order
    said: str = "Waiting"
    progress: float = 0.0
    error: str = ""
    warnings: list[str] = field(default_factory=list)
    painted: list[Path] = field(default_factory=list)
    _cancelled: threading.Event = field(default_factory=threading.Event)

    def start(self) -> Painting:
        """Begin in a thread; returns this painting."""
        self._thread = threading.Thread(target=self._run, name="impasto", daemon=True)
        self._thread.start()
        return self

    @property
    def running(self) -> bool:
        return self._thread.is_alive()

    def wait(self, timeout_s: float) -> None:
        self._thread.join(timeout_s)

    def cancel(self) -> None:
        """Stop sending, cancel the job; files that exist stay as they are."""
        self._cancelled.set()

    def _run(self) -> None:
        try:
            with self.order.client() as client:
                self.painted = self._paint(client)
                self.said, self.progress = f"{len(self.painted)} frames painted", 1.0
        except Cancelled:
            self.said = "Cancelled"
        except (ImpastoError, OSError) as error:
            self.error = str(error)

    def _paint(self, client: Client) -> list[Path]:
        with tempfile.TemporaryDirectory(prefix="impasto-") as scratch:
            self.said = "Sending the frames"
            sent = uploaded(client, self.order, Path(scratch), self._told)
            job = client.submit(**job_request(self.order, sent))
            self.warnings = [warning["message"] for warning in job["warnings"]]
            self._follow(client, job["id"])
            self.said = "Fetching the painted frames"
            archive = client.download(job["id"], Path(scratch) / "painted.zip", progress=self._checked)
            return unpacked(archive, self.order.folder)

    def _follow(self, client: Client, job_id: str) -> None:
        """Wait for the job. Raises: JobFailed; Cancelled after the job was cancelled."""
        for job in client.watch(job_id):
            if self._cancelled.is_set() and job["state"] not in FINAL:
                client.cancel(job_id)
                raise Cancelled("Cancelled.")
            if job["state"] in FINAL and job["state"] != "succeeded":
                raise job_failed(job)
            self.progress = 0.1 + 0.85 * job["progress"]
            left = job["eta_s"]
            self.said = f"Painting: {job['progress']:.0%}" + (f", {duration(left)} left" if left else "")

    def _told(self, done: int, total: int) -> None:
        self._checked(done, total)
        self.progress = 0.1 * done / max(total, 1)

    def _checked(self, done: int, total: int) -> None:
        if self._cancelled.is_set():
            raise Cancelled("Cancelled.")


def check(order: Order) -> str:
    """Send the frames, and ask what painting them would take: a sentence. The upload is used again by the painting.

    Raises: ImpastoError with field, value and remedy.
    """
    with order.client() as client, tempfile.TemporaryDirectory(prefix="impasto-") as scratch:
        found = client.estimate(job_request(order, uploaded(client, order, Path(scratch), lambda done, total: None)))
    (job,), ahead = found["items"], found["jobs_ahead"]
    time_needed = "unknown time" if job["seconds"] is None else f"about {duration(float(job['seconds']))}"
    return f"{job['frames']} frames, {time_needed}, {ahead} jobs ahead"


def job_request(order: Order, sent: Mapping[str, str]) -> dict[str, Any]:
    """The body of `POST /v1/jobs`; `sent`: input name -> asset id."""
    return {
        "method": order.method, "inputs": dict(sent), "params": dict(order.params), "seed": order.seed,
        "output": {"format": order.form}, "name": order.frames[0].stem,
    }  # fmt: skip


def uploaded(client: Client, order: Order, scratch: Path, progress: Callable[[int, int], None]) -> dict[str, str]:
    """Send what the service does not have yet: input name -> asset id."""
    if not order.frames:
        raise BadInput("There are no rendered frames.", field="frames", remedy="Render, or choose their folder.")
    video = scratch / "frames.zip"
    zip_pictures(order.frames, video, order.fps)
    sent = {"video": str(client.upload(video, progress)["id"])}
    for name, where in order.inputs.items():
        sent[name] = where if where.startswith("ast_") else str(client.upload(_as_file(name, where, scratch))["id"])
    return sent


def _as_file(name: str, where: str, scratch: Path) -> Path:
    path = Path(where)
    if not path.is_dir():
        return path
    target = scratch / f"{name}.zip"
    zip_pictures(sorted(p for p in path.iterdir() if p.is_file() and not p.name.startswith(".")), target)
    return target


def zip_pictures(files: Sequence[Path], target: Path, fps: float | None = None) -> None:
    """Zip files by name, uncompressed, with a fixed date: the same files give the same asset."""
    with zipfile.ZipFile(target, "w", zipfile.ZIP_STORED) as archive:
        for file in files:
            archive.writestr(zipfile.ZipInfo(file.name, EPOCH), file.read_bytes())
        if fps is not None:
            archive.writestr(zipfile.ZipInfo("sequence.json", EPOCH), json.dumps({"fps": fps}))


def unpacked(archive: Path, folder: Path) -> list[Path]:
    """Write the pictures of a result into the folder, each whole or not at all, in order.

    Raises: BadInput if one of them is there already.
    """
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    with zipfile.ZipFile(archive) as pictures:
        names = sorted(name for name in pictures.namelist() if _DIGITS.search(name))
        targets = [folder / f"painted.{_DIGITS.search(Path(name).name)[1]}{Path(name).suffix}" for name in names]
        if there := [target for target in targets if target.exists()]:
            raise BadInput("Painted frames are there already.", field="folder", value=there[0],
                           remedy="Choose another folder; nothing was overwritten.")  # fmt: skip
        for name, target in zip(names, targets, strict=True):
            part = target.with_name(f".{target.name}.part")
            part.write_bytes(pictures.read(name))
            part.replace(target)
            written.append(target)
    return written


def rendered(folder: Path) -> list[Path]:
    """Pictures of a folder whose names end in a number, by number."""
    found = [p for p in folder.iterdir() if p.is_file() and not p.name.startswith(".") and _DIGITS.search(p.name)]
    pictures = [p for p in found if p.suffix.lower() in {".exr", ".png", ".tif", ".tiff", ".jpg", ".jpeg", ".dpx"}]
    return sorted(pictures, key=number_of)


def number_of(path: Path) -> int:
    """The frame number at the end of a name."""
    found = _DIGITS.search(path.name)
    if not found:
        raise BadInput("The name has no frame number.", field="frames", value=path.name, remedy="Use name.0001.exr.")
    return int(found[1])


def parsed_params(text: str) -> dict[str, Any]:
    """Parameters from "name=value name=value"; values are JSON, or text if they are not."""
    found: dict[str, Any] = {}
    for word in text.split():
        name, equals, value = word.partition("=")
        if not equals or not name:
            raise BadParameter("Parameters are name=value, with spaces between.", field="parameters", value=word,
                               remedy="For example: lines=off detail=0.5")  # fmt: skip
        try:
            found[name] = json.loads(value)
        except ValueError:
            found[name] = value
    return found


def duration(seconds: float) -> str:
    """A time that a user can read."""
    if seconds < 60:
        return f"{max(seconds, 1):.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


def unused_folder(parent: Path) -> Path:
    """`painted-001`, or the next that does not exist."""
    return next(p for k in range(1, 10_000) if not (p := parent / f"painted-{k:03d}").exists())


def waited(painting: Painting, interval_s: float = 0.1) -> Painting:
    """Wait for a painting, for scripts. Raises: RuntimeError with its error."""
    while painting.running:
        time.sleep(interval_s)
    if painting.error:
        raise RuntimeError(painting.error)
    return painting
