"""Overhead of the farm and its stores: the share of a render's CPU time that is not decoding, painting and encoding.

One job of every method runs in a farm in this process, with SQLite and blobs on a disk. Overhead is all CPU time of the
farm's own threads (dispatching, events, leases, garbage collection, waiting), and the CPU time that workers' threads
spend on storing and fetching artefacts, blobs, segments and progress pictures, and on joining the segments.
"""

from __future__ import annotations

import argparse
import multiprocessing
import tempfile
import threading
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import psutil

from benchmarks.loops import looped, source

CLIP, SIZE = "dog_720p_audio.mp4", "1280x720"
FRAMES = {"abstraction": (60, 120), "multistyle": (36, 72), "patches": (24, 48), "analogy": (3, 6)}
"""Two job lengths for each method, in frames; the fixed cost of a job and the cost per frame follow from them."""
LONG = 300


def main() -> None:
    """Print two measured rows for each method, and a row extrapolated from them to LONG frames, because a job of that
    length takes an hour with analogy. The benchmark takes about four minutes on two idle processors.
    """
    parser = argparse.ArgumentParser(description="CPU time of the farm and its stores relative to a whole render.")
    parser.add_argument("method", nargs="?", choices=FRAMES, help="all methods, one after the other, if omitted")
    parser.add_argument("frames", nargs="?", type=int, help="frames of a single job, instead of two short jobs")
    given = parser.parse_args() if __name__ == "__main__" else parser.parse_args([])
    names = [given.method] if given.method else list(FRAMES)
    print(f"{'method':>12} {'frames':>7} {'wall s':>7} {'CPU s':>8} {'overhead s':>11} {'share':>7}   by part, CPU s")
    with tempfile.TemporaryDirectory(prefix="impasto-overhead-") as scratch:
        clip = source(CLIP, SIZE, Path(scratch))
        for name in names:
            lengths = (given.frames,) if given.frames else FRAMES[name]
            runs = [(frames, _job(name, frames, clip, Path(scratch))) for frames in lengths]
            for frames, run in runs:
                _row(name, f"{frames}", *run)
            if len(runs) == 2:
                _row(name, f"~{LONG}", *_prolonged(*runs))


Run = tuple[float, float, dict[str, float]]
"""(wall seconds, CPU seconds, CPU seconds of the overhead by part)"""


def _job(name: str, frames: int, clip: Path, folder: Path) -> Run:
    """Measure a job in a separate process."""
    long = looped(clip, frames, folder / f"{name}-{frames}.mp4")
    with multiprocessing.get_context("spawn").Pool(1) as one:
        return one.apply(measure, (name, long, folder / f"home-{name}-{frames}"))


def _prolonged(first: tuple[int, Run], second: tuple[int, Run]) -> Run:
    """Extrapolate linearly from two short jobs to a job of LONG frames."""
    (a, (wall_a, total_a, parts_a)), (b, (wall_b, total_b, parts_b)) = first, second

    def at(of_a: float, of_b: float) -> float:
        return max(of_b, of_b + (of_b - of_a) * (LONG - b) / (b - a))

    parts = {part: at(parts_a.get(part, 0.0), seconds) for part, seconds in parts_b.items()}
    return at(wall_a, wall_b), at(total_a, total_b), parts


def _row(name: str, frames: str, wall: float, total: float, parts: dict[str, float]) -> None:
    cost = sum(parts.values())
    where = "  ".join(f"{part} {seconds:.2f}" for part, seconds in sorted(parts.items()))
    print(f"{name:>12} {frames:>7} {wall:7.1f} {total:8.1f} {cost:11.2f} {cost / total:7.2%}   {where}", flush=True)


def measure(name: str, clip: Path, home: Path) -> Run:
    """Times of a job in seconds: wall time, CPU time of the process, CPU time of the overhead by part."""
    from impasto.cli import private_farm
    from pipeline.methods import method, parse_params
    from workers.contract.request import JobRequest
    from workers.execution.warm_up import warm_up

    warm_up(method(name), parse_params(method(name), {}))
    counted = _count_stores()
    with private_farm.opened(home, 1) as farm:
        video = farm.assets.add(clip, clip.name).id
        since, began, before = time.monotonic(), _cpu(), _threads()
        counted.clear()
        job = farm.jobs.submit(JobRequest(name, {"video": video}))
        private_farm.follow(farm, job.id, lambda state: None)
        total, after, wall = _cpu() - began, _threads(), time.monotonic() - since
    parts = defaultdict[str, float](float, counted)
    for thread, seconds in after.items():
        if thread in OF_THE_FARM:
            parts[OF_THE_FARM[thread]] += seconds - before.get(thread, 0.0)
    return wall, total, dict(parts)


OF_THE_FARM = {
    "impasto-dispatcher": "dispatch", "impasto-collector": "sweep", "impasto-events": "events", "MainThread": "client",
}  # fmt: skip


def _cpu() -> float:
    """CPU seconds of this process and of its decoder processes."""
    mine = psutil.Process()
    times = [process.cpu_times() for process in (mine, *mine.children(recursive=True))]
    return sum(each.user + each.system for each in times)


def _threads() -> dict[str, float]:
    """CPU seconds of this process's Python threads, by thread name."""
    known = {thread.native_id: thread.name for thread in threading.enumerate()}
    spent: dict[str, float] = defaultdict(float)
    for row in psutil.Process().threads():
        if row.id in known:
            spent[known[row.id]] += row.user_time + row.system_time
    return dict(spent)


def _count_stores() -> dict[str, float]:
    """Instrument the stores' functions; the returned dictionary accumulates their CPU seconds by part."""
    from workers.blobs.disk import DiskBlobs
    from workers.execution.context import AttemptContext
    from workers.execution.preview_publisher import PreviewPublisher
    from workers.execution.renderer import Renderer

    counted: dict[str, float] = defaultdict(float)
    inside = threading.local()

    def count(owner: type, name: str, part: str) -> None:
        does: Callable[..., Any] = getattr(owner, name)

        def counting(*args: Any, **more: Any) -> Any:
            if getattr(inside, "on", False) or not threading.current_thread().name.startswith("impasto-worker"):
                return does(*args, **more)
            inside.on, began = True, time.thread_time()
            try:
                return does(*args, **more)
            finally:
                counted[part] += time.thread_time() - began
                inside.on = False

        setattr(owner, name, counting)

    for name in ("save", "load", "save_file"):
        count(AttemptContext, name, "artefacts")
    for name in ("put", "get", "size"):
        count(DiskBlobs, name, "blobs")
    count(PreviewPublisher, "put", "shows")
    count(Renderer, "_assemble", "join")
    return counted


if __name__ == "__main__":
    main()
