"""One shot on many processors: processor seconds, critical path, and speed-up by replay of measured tasks.

    python -m benchmarks.one_shot METHOD [WIDTH [FRAMES]]      one row of the table; all methods without arguments

A job of one shot runs in this process, one task after another, with the store, decoding, encoding and blobs as in a
worker. Each task is measured: the processor time of this process, and that of the task's busiest thread. The tasks use
as many threads as on a machine with `MACHINE` processors; kernels of a CPU's compute device use all of them. Then the
job of a shot of `LONG` frames is planned, its tasks get the measured rates of their kind, and `workers.jobs.replay`
runs them on 2 to 64 processors.
"""

from __future__ import annotations

import sys
import tempfile
import threading
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from benchmarks.clips import MEDIA
from benchmarks.speedup import style_of, submit
from pipeline.methods.base import TaskResult
from workers.contract.request import JobRequest, Json
from workers.execution.stage_timer import StageTimer
from workers.jobs.frame_window import window_inputs
from workers.jobs.replay import PROCESSORS, TimedTask, critical_path, replayed
from workers.scheduling.explanation import named, plans_of, timed_tasks

CLIP = "coffee_720p_audio.mp4"
SHOTS = {"abstraction": (1280, 120), "multistyle": (640, 120), "steady": (640, 120), "patches": (640, 120),
         "analogy": (320, 24)}  # fmt: skip
"""Method -> (width in px, frames); 16:9."""
LONG = 240
MACHINE = 16
WARM_FRAMES = 6


def main() -> None:
    """Print a row for each method."""
    words = sys.argv[1:] if __name__ == "__main__" else []
    head = " | ".join(f"{count}" for count in PROCESSORS[1:])
    print(f"| method | shot | tasks | CPU s | path s | limit | {head} |")
    print("|" + "---|" * (6 + len(PROCESSORS[1:])))
    for name in words[:1] or SHOTS:
        width, frames = (*(int(word) for word in words[1:]), *SHOTS[name][len(words[1:]) :])
        measured = measure(name, width, frames)
        shot = f"{frames} frames of {width}x{width * 9 // 16}"
        _row(name, shot, measured.tasks)
        _row(name, f"{LONG} frames", measured.prolonged(LONG))


def _row(name: str, shot: str, tasks: Sequence[TimedTask]) -> None:
    total, path = sum(task.seconds for task in tasks), sum(task.shortest_s for task in critical_path(tasks))
    alone = replayed(tasks, 1)
    speeds = " | ".join(f"{alone / replayed(tasks, count):.1f}" for count in PROCESSORS[1:])
    print(f"| {name} | {shot} | {len(tasks)} | {total:.1f} | {path:.1f} | {total / path:.1f} | {speeds} |", flush=True)


@dataclass(frozen=True)
class Measured:
    """A job that has run."""

    request: JobRequest
    info: Mapping[str, Json]
    results: Mapping[str, Mapping[str, TaskResult]]
    tasks: Sequence[TimedTask]

    def prolonged(self, frames: int) -> list[TimedTask]:
        """The tasks of a shot of so many frames, with the rates of this job's."""
        plans, _ = plans_of(self.request, self.info, self.results)
        steps = list(plans)
        weights: dict[str, float] = defaultdict(float)
        for step, tasks in plans.items():
            for task in tasks:
                weights[named(step, task.key)] += task.weight
        seconds: dict[str, float] = defaultdict(float)
        shortest: dict[str, float] = defaultdict(float)
        for timed in self.tasks:
            kind = named(steps[timed.step], timed.key)
            seconds[kind] += timed.seconds
            shortest[kind] += timed.shortest_s
        every = sum(seconds.values()) / sum(weights.values())

        def rate(kind: str) -> tuple[float, float]:
            if kind not in seconds:
                return every, 1.0
            return seconds[kind] / weights[kind], max(1.0, seconds[kind] / shortest[kind])

        first = steps[0]
        found = {key: {**result, "frames": frames} if "frames" in result else result
                 for key, result in self.results[first].items()}  # fmt: skip
        video = {**self.info["video"], "frames": frames}
        plans, _ = plans_of(self.request, {**self.info, "video": video}, {first: found})
        return timed_tasks(plans, rate)


def measure(name: str, width: int, frames: int) -> Measured:
    """Run the job and measure its tasks."""
    from pipeline.compute import Device
    from workers.execution import context
    from workers.execution.renderer import Renderer
    from workers.farm import Farm
    from workers.scheduling.in_turn import run_in_turn
    from workers.settings import FarmSettings

    _use_many_threads()
    vars(context)["StageTimer"] = _ThreadTimer
    for wait in ("upload", "download", "finish"):
        setattr(Device, wait, _ThreadTimer.of_kernels(getattr(Device, wait)))
    tasks: list[TimedTask] = []
    with tempfile.TemporaryDirectory(prefix="impasto-one-shot-") as folder:
        settings = FarmSettings(home=Path(folder), pool="none", reserve_bytes=0)
        farm = Farm(settings, None)
        with Renderer(farm.blobs, settings.scratch, overview=False) as renderer:
            for count in (WARM_FRAMES, frames):
                clip = _clip(Path(folder), count, width)
                asset, tasks = farm.assets.add(clip, clip.name).id, []
                inputs = {"video": asset} | ({"styled": asset} if name == "steady" else {})
                if style := style_of(name):
                    inputs["style_output"] = farm.assets.add(style, style.name).id
                job = farm.jobs.get(submit(farm, name, inputs))
                _ThreadTimer.clear()
                for run in run_in_turn(farm.store, renderer):
                    if run.outcome.fault is not None:
                        raise SystemExit(f"{run.order.step}/{run.order.key}: {run.outcome.fault}")
                    busiest, computes = _ThreadTimer.clear()
                    after = tuple(key for key in run.order.after if "/" not in key)
                    shortest = busiest + (run.seconds - busiest) / MACHINE if computes else busiest
                    threads = max(1.0, run.seconds / shortest) if shortest else 1.0
                    tasks.append(TimedTask(run.step, run.order.key, run.seconds, after, threads))
        results, _ = farm.store.task_inputs.before(job.id, len(job.steps))
        info = window_inputs(farm.store.task_inputs.input_info(job.request.inputs), None)
        farm.stop()
    return Measured(job.request, info, results, tasks)


class _ThreadTimer(StageTimer):
    """Also counts the processor time of each Python thread that works on the attempt, without that of kernels, which a
    thread computes while it waits for a CPU's compute device."""

    _spent: ClassVar[dict[int, float]] = defaultdict(float)
    _computed: ClassVar[dict[int, float]] = defaultdict(float)
    _depth = threading.local()

    @classmethod
    def clear(cls) -> tuple[float, bool]:
        """Forget all threads; returns the processor time of the busiest one, seconds, and whether there were
        kernels."""
        busiest = max((spent - cls._computed[thread] for thread, spent in cls._spent.items()), default=0.0)
        computes = any(cls._computed.values())
        cls._spent.clear()
        cls._computed.clear()
        return busiest, computes

    @classmethod
    def of_kernels(cls, wait: Callable[..., Any]) -> Callable[..., Any]:
        """A function that waits for the device, and counts the time."""

        def counted(*args: Any) -> Any:
            began = time.thread_time()
            try:
                return wait(*args)
            finally:
                if getattr(cls._depth, "inside", False):
                    cls._computed[threading.get_ident()] += time.thread_time() - began

        return counted

    @contextmanager
    def _counted(self) -> Iterator[None]:
        if getattr(self._depth, "inside", False):
            yield
            return
        self._depth.inside, began = True, time.thread_time()
        try:
            yield
        finally:
            self._depth.inside = False
            self._spent[threading.get_ident()] += time.thread_time() - began

    @contextmanager
    def clock(self, stage: str) -> Iterator[None]:
        with self._counted(), super().clock(stage):
            yield

    @contextmanager
    def waiting(self, stage: str) -> Iterator[None]:
        with self._counted(), super().waiting(stage):
            yield

    @contextmanager
    def method(self) -> Iterator[None]:
        with self._counted(), super().method():
            yield


def _use_many_threads() -> None:
    """Let every module see the processors of a large machine, and helper threads begin at once, as they do there."""
    import pipeline.methods  # noqa: F401 (loads the modules)
    from pipeline.kernels import executors, processors

    given = processors.usable_processors
    for module in [*sys.modules.values()]:
        if getattr(module, "usable_processors", None) is given:
            module.usable_processors = lambda: MACHINE  # type: ignore[attr-defined]
    vars(executors)["Submitted"].result = lambda self: self.future.result()


def _clip(folder: Path, frames: int, width: int) -> Path:
    """The first frames of a real clip of one shot at this width."""
    import av

    path = folder / f"shot-{frames}.mp4"
    with av.open(str(MEDIA / CLIP)) as given, av.open(str(path), "w") as out:
        stream: Any = out.add_stream("libx264", rate=given.streams.video[0].average_rate)
        stream.width, stream.height, stream.pix_fmt = width, width * 9 // 16, "yuv420p"
        for number, frame in enumerate(given.decode(video=0)):
            if number == frames:
                break
            out.mux(stream.encode(frame.reformat(stream.width, stream.height, "yuv420p", interpolation="AREA")))
        out.mux(stream.encode(None))
    return path


if __name__ == "__main__":
    main()
