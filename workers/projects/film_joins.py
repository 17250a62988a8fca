"""Joins the films of shots into one file, one film at a time, in a thread of this process.

A joined film is an asset that belongs to the first shot's job, as the films of exports do: it counts for no quota,
appears in no listing, and is deleted with that job. A join that this process does not finish is begun again when the
film is next asked for.
"""

from __future__ import annotations

import hashlib
import tempfile
import threading
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import ExitStack
from pathlib import Path

from pipeline.errors import Cancelled
from pipeline.formats import output_format
from pipeline.video.assembly import assemble
from workers.contract.record import Asset, Job
from workers.contract.request import OutputSpec
from workers.farm_parts.assets import FarmAssets
from workers.farm_parts.files import FarmFiles

_PREFIX = "assembled-"
_KEPT = 4
"""Files that are kept for one first job: other films can be made again."""


class FilmJoins:
    """The joined films that exist, and those that are being made."""

    def __init__(self, assets: FarmAssets, files: FarmFiles, scratch: Path) -> None:
        self._assets, self._files, self._scratch = assets, files, scratch
        self._thread = ThreadPoolExecutor(1, "impasto-join")
        self._running: dict[str, Future[None]] = {}
        self._done: dict[str, float] = {}
        self._lock, self._closing = threading.Lock(), threading.Event()

    def find(self, jobs: Sequence[Job], output: OutputSpec) -> Asset | None:
        """The joined film of these finished jobs; None: it is not made yet."""
        name = _name(jobs, output)
        return next((asset for asset in self._made(jobs) if asset.filename == name), None)

    def progress(self, jobs: Sequence[Job], output: OutputSpec) -> float | None:
        """The fraction of the join that is done, 0..1; None: it is not being made."""
        name = _name(jobs, output)
        with self._lock:
            running = self._running.get(name)
            return None if running is None or running.done() else self._done.get(name, 0.0)

    def make(self, jobs: Sequence[Job], output: OutputSpec, wait_s: float) -> Asset | None:
        """Begin the join unless it has begun, and wait for it at most `wait_s` seconds; None: it is not finished.

        Raises: BadParameter, UnreadableMedia: as `assemble`.
        """
        name = _name(jobs, output)
        with self._lock:
            if name not in self._running:
                self._running[name] = self._thread.submit(self._join, name, tuple(jobs), output)
            running = self._running[name]
        wait([running], wait_s)
        if not running.done():
            return None
        with self._lock:
            self._running.pop(name, None)
            self._done.pop(name, None)
        running.result()
        return self.find(jobs, output)

    def close(self) -> None:
        """Give up joins that are not finished."""
        self._closing.set()
        self._thread.shutdown(wait=True, cancel_futures=True)

    def _made(self, jobs: Sequence[Job]) -> list[Asset]:
        owned = self._assets.page(owner=jobs[0].id).items
        return [asset for asset in owned if asset.filename.startswith(_PREFIX)]

    def _join(self, name: str, jobs: Sequence[Job], output: OutputSpec) -> None:
        if self.find(jobs, output) is not None:
            return
        owner = jobs[0].id
        for old in self._made(jobs)[_KEPT - 1 :]:
            self._assets.delete(old.id, owner)
        self._scratch.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix="film-", dir=self._scratch) as folder, ExitStack() as opened:
            paths = [opened.enter_context(self._files.local(self._files.get(job.id, "result"))) for job in jobs]
            out = Path(folder) / name
            assemble(paths, out, output.format, output.quality, output.profile, lambda done: self._note(name, done))
            self._assets.add(out, name, owner=owner)

    def _note(self, name: str, done: float) -> None:
        if self._closing.is_set():
            raise Cancelled("The service ends.")
        with self._lock:
            self._done[name] = done


def _name(jobs: Sequence[Job], output: OutputSpec) -> str:
    digest = hashlib.sha256(" ".join(job.id for job in jobs).encode()).hexdigest()[:32]
    return f"{_PREFIX}{digest}{output_format(output.format).suffixes[0]}"
