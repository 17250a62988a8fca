"""Speedup of two workers over one on a real farm with Ray, a database and blobs. Both must give the same bytes.

    python -m benchmarks.scaling                    every method, three turns: about five minutes on an idle machine
    python -m benchmarks.scaling METHOD ...         the named methods; `--turns N`

Two farms, each with its own Ray cluster, run side by side and take turns at the same job: one has one worker, the other
has two. Each worker, with its decoders, is bound to one processor; otherwise a single worker would use both, because a
task is multithreaded. The time of a step is taken from the farm's record of attempts, from the start of the first
attempt to the end of the last. A step of one task (`scan`, `assemble`) cannot become faster, so the steps of several
tasks are also summed separately.
"""

from __future__ import annotations

import argparse
import hashlib
import multiprocessing
import os
import statistics
import tempfile
import time
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import psutil

from benchmarks.speedup import METHODS, short, style_of, submit

FILMS = {"abstraction": (250, 480), "patches": (150, 320), "analogy": (60, 112), "multistyle": (144, 480)}
"""(frames, width in px) of a film with cuts, chosen so that a job takes ten to thirty seconds of one processor."""
TURNS = 3
READY_S, POLL_S = 60.0, 0.5


@dataclass(frozen=True)
class Run:
    """Times and result of one job on one farm."""

    seconds: float
    """Seconds from the start of the first attempt to the end of the last one."""
    steps: dict[str, float]
    """Step -> seconds from the start of its first attempt to the end of its last one."""
    tasks: dict[str, int]
    sha256: str


def main() -> None:
    """Print a row for each method and each of its steps."""
    parser = argparse.ArgumentParser(description="Speedup of two workers over one on a real farm.")
    parser.add_argument("methods", nargs="*", metavar="METHOD", help=f"{', '.join(METHODS)}; all of them if omitted")
    parser.add_argument("--turns", type=int, default=TURNS)
    given = parser.parse_args() if __name__ == "__main__" else parser.parse_args([])
    spawn = multiprocessing.get_context("spawn")
    with tempfile.TemporaryDirectory(prefix="impasto-scaling-") as scratch:
        farms = [_Farm(spawn, Path(scratch) / f"home-{workers}", workers) for workers in (1, 2)]
        try:
            for name in given.methods or METHODS:
                film, _ = short(Path(scratch), *FILMS[name])
                warm, _ = short(Path(scratch), 2, FILMS[name][1])
                for farm in farms:
                    farm.run(name, warm, 0)
                turns = [[farm.run(name, film, 0) for farm in farms] for _ in range(given.turns)]
                _print(name, turns)
        finally:
            for farm in farms:
                farm.end()


def _print(name: str, turns: Sequence[Sequence[Run]]) -> None:
    first = turns[0][0]
    same = len({run.sha256 for turn in turns for run in turn}) == 1
    print(f"{name}, {FILMS[name][0]} frames of {FILMS[name][1]} px, {'the same' if same else 'DIFFERENT'} bytes")
    _row("whole job", [[run.seconds for run in turn] for turn in turns], sum(first.tasks.values()))
    for step, tasks in first.tasks.items():
        _row(step, [[run.steps[step] for run in turn] for turn in turns], tasks)
    wide = [step for step, tasks in first.tasks.items() if tasks > 1]
    _row("steps of several tasks", [[sum(run.steps[step] for step in wide) for run in turn] for turn in turns], 0)
    if not same:
        raise SystemExit("The results of one worker and of two workers differ.")


def _row(what: str, seconds: Sequence[Sequence[float]], tasks: int) -> None:
    one, two = (statistics.median(column) for column in zip(*seconds, strict=True))
    ratio = statistics.median(a / b for a, b in seconds)
    count = f"{tasks:4} tasks" if tasks else " " * 10
    print(f"{what:>24} {count}  1 worker {one:6.2f} s  2 workers {two:6.2f} s  {ratio:.2f} times", flush=True)


class _Farm:
    """A farm in a separate process, because a process can belong to one Ray cluster only."""

    def __init__(self, spawn: Any, home: Path, workers: int) -> None:
        self._pipe, theirs = spawn.Pipe()
        self._process = spawn.Process(target=_serve, args=(theirs, home, workers))
        self._process.start()

    def run(self, method: str, film: Path, seed: int) -> Run:
        self._pipe.send((method, film, seed))
        answer = self._pipe.recv()
        if isinstance(answer, str):
            raise SystemExit(answer)
        assert isinstance(answer, Run)
        return answer

    def end(self) -> None:
        self._pipe.send(None)
        self._process.join(30)
        self._process.kill()


def _serve(pipe: Connection, home: Path, workers: int) -> None:
    """Run the jobs that arrive on the pipe, until None arrives."""
    from workers.farm import open_farm
    from workers.settings import FarmSettings

    farm = open_farm(FarmSettings(home=home, pool="ray", workers=workers, reserve_bytes=0, live_spares=0))
    farm.start()
    try:
        while (asked := pipe.recv()) is not None:
            _bind(_until_ready(farm, workers))
            pipe.send(_run(farm, *asked))
    finally:
        farm.stop()


def _until_ready(farm: Any, workers: int) -> list[int]:
    """Wait until all workers of the farm are up; their process ids."""
    deadline = time.monotonic() + READY_S
    while time.monotonic() < deadline:
        slots = [slot for worker in farm.workers.workers().items for slot in worker.slots]
        if len(slots) == workers:
            return [int(slot.name.rpartition(":")[2]) for slot in slots]
        time.sleep(0.2)
    raise SystemExit("The farm's workers do not start.")


def _bind(pids: Sequence[int]) -> None:
    """Bind each worker, with its threads and children, to a different processor."""
    processors = sorted(os.sched_getaffinity(0))
    for place, pid in enumerate(pids):
        for process in (root := psutil.Process(pid), *root.children(recursive=True)):
            for thread in process.threads():
                os.sched_setaffinity(thread.id, {processors[place % len(processors)]})


def _run(farm: Any, name: str, film: Path, seed: int) -> Run | str:
    inputs = {"video": farm.assets.add(film, film.name).id}
    if style := style_of(name):
        inputs["style_output"] = farm.assets.add(style, style.name).id
    job_id = submit(farm, name, inputs)
    while not (job := farm.jobs.get(job_id)).state.final:
        time.sleep(POLL_S)
    if job.state != "succeeded":
        return f"The job of {name} {job.state}: {job.error}"
    bars = [bar for bar in farm.workers.timeline(job_id).items if bar.outcome == "succeeded"]
    spans: dict[str, list[Any]] = defaultdict(list)
    for bar in sorted(bars, key=lambda bar: bar.started_at):
        spans[bar.step].append(bar)
    digest = hashlib.sha256(b"".join(farm.files.read(farm.files.get(job_id, "result")))).hexdigest()
    steps = {step: _span(found) for step, found in spans.items()}
    return Run(_span(bars), steps, {step: len(found) for step, found in spans.items()}, digest)


def _span(bars: Sequence[Any]) -> float:
    return float(max(bar.finished_at for bar in bars) - min(bar.started_at for bar in bars))


if __name__ == "__main__":
    main()
