"""Speedup of a job with 1 to 512 workers, and the limit that prevents more. A simulation from recorded tasks.

    python -m benchmarks.speedup record METHOD ...     run a short job of the method, one task after another; write the
                                                       time of each task to benchmarks/recorded/METHOD.json
    python -m benchmarks.speedup                       print the table

The recorded jobs are real: a film with cuts and small frames, run with the store, planning, decoding, encoding and
blobs as in a worker. Times are CPU seconds, so that other work on the machine does not count. The simulation follows
the dispatchers: steps run one after the other, a task becomes ready when the tasks it depends on are done, ready tasks
go in plan order to any idle worker, and each task costs a claim and an outcome, which the database serialises.

A short job has few tasks. A *film* simulates N such clips in a row: a step that planned several tasks has N times as
many; a step that planned one task (it reads the whole video) has one task that takes N times as long. The film's frames
are 1280 px wide, and the time of every task grows in proportion to the pixels.
"""

from __future__ import annotations

import json
import sys
import tempfile
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from workers.jobs.replay import TimedTask, critical_path, replayed

RECORDED = Path(__file__).parent / "recorded"
METHODS = ("abstraction", "patches", "analogy", "multistyle")
WORKERS = (1, 2, 4, 8, 16, 32, 64, 128, 256, 512)
WARM_FRAMES = 40
"""The film's first cut is at frame 30."""
FILMS = (1, 100)
"""Numbers of clips in the simulated films."""
FILM_WIDTH_PX = 1280
"""Frame width of the simulated films, px. Task times grow with the number of pixels; database times do not."""
CLIP = "bikes_scene_cuts.mp4"
SIZES = {"abstraction": (250, 640), "patches": (96, 192), "analogy": (96, 128), "multistyle": (96, 192)}
"""(frames, width in px) of the recorded jobs, chosen so that a recording takes one or two minutes."""
STYLE = "paintings"
EXTRAPOLATED = f"""\
These figures are simulated and extrapolated, not measured. For each method, one short clip of small frames was recorded
(4 to 10 s, 128 to 640 px wide). Rows of {FILMS[-1] * min(frames for frames, _ in SIZES.values()):,} and more frames
repeat its tasks {FILMS[-1]} times; a step of one task takes {FILMS[-1]} times as long. Times are scaled by the number
of pixels to a width of {FILM_WIDTH_PX} px. The simulation does not model contention for disks, networks or caches.
"""


@dataclass(frozen=True)
class Recorded:
    method: str
    clip: str
    frames: int
    size: tuple[int, int]
    steps: tuple[str, ...]
    dispatch_s: float
    """Seconds of database work per task: one claim and one answer."""
    tasks: tuple[TimedTask, ...]

    @property
    def work_s(self) -> float:
        return sum(task.seconds for task in self.tasks)


@dataclass(frozen=True)
class Outcome:
    """The result of a simulation."""

    seconds: float
    limit: str
    """The limit that prevents a further speedup with more workers."""


# -- the simulation


def simulate(job: Recorded, workers: int) -> float:
    """Seconds from the first claim to the last answer."""
    return replayed(job.tasks, workers, job.dispatch_s)


def explain(job: Recorded, workers: int) -> Outcome:
    """Simulate the job, and name the largest lower bound of its time."""
    seconds = simulate(job, workers)
    path = critical_path(job.tasks)
    chains = [sum(task.shortest_s for task in path if task.step == step) for step in range(len(job.steps))]
    bounds = {"workers": job.work_s / workers, "the database's claims": len(job.tasks) * job.dispatch_s}
    for step, chain in enumerate(chains):
        bounds[_name(job, step)] = chain
    if max(bounds["workers"], bounds["the database's claims"]) >= sum(chains):
        return Outcome(seconds, max(("workers", "the database's claims"), key=lambda name: bounds[name]))
    worst = max(range(len(chains)), key=lambda step: chains[step])
    return Outcome(seconds, f"{_name(job, worst)}: {100 * chains[worst] / sum(chains):.0f} % of the longest path")


def _name(job: Recorded, step: int) -> str:
    tasks = [task for task in job.tasks if task.step == step]
    if len(tasks) == 1:
        return f"`{job.steps[step]}`, one task"
    kind = "the longest chain" if any(task.after for task in tasks) else "the longest task"
    return f"`{job.steps[step]}`, {kind} of {len(tasks)} tasks"


def larger(job: Recorded, width_px: int) -> Recorded:
    """The job with its times scaled to larger frames."""
    times = (width_px / job.size[0]) ** 2
    size = (width_px, round(job.size[1] * width_px / job.size[0]))
    tasks = tuple(replace(task, seconds=times * task.seconds) for task in job.tasks)
    return replace(job, size=size, tasks=tasks)


def film(job: Recorded, clips: int) -> Recorded:
    """The job of a film of `clips` such clips in a row."""
    tasks: list[TimedTask] = []
    for step in range(len(job.steps)):
        mine = [task for task in job.tasks if task.step == step]
        if len(mine) == 1:
            tasks.append(replace(mine[0], seconds=clips * mine[0].seconds))
            continue
        for clip in range(clips):
            tasks += [
                replace(task, key=f"{task.key}-{clip}", after=tuple(f"{key}-{clip}" for key in task.after))
                for task in mine
            ]
    return replace(job, tasks=tuple(tasks), frames=clips * job.frames)


# -- recording


def record(name: str) -> Recorded:
    """Run a job of the method in this process, one task after another, and record the time of each task."""
    from workers.execution.renderer import Renderer
    from workers.farm import Farm
    from workers.settings import FarmSettings

    with tempfile.TemporaryDirectory(prefix="impasto-speedup-") as folder:
        settings = FarmSettings(home=Path(folder), pool="none", reserve_bytes=0)
        farm = Farm(settings, None)
        clip, size = short(Path(folder), *SIZES[name])
        inputs = {"video": farm.assets.add(clip, clip.name).id}
        if style := style_of(name):
            inputs["style_output"] = farm.assets.add(style, style.name).id
        with Renderer(farm.blobs, settings.scratch) as renderer:
            warm = short(Path(folder), WARM_FRAMES, SIZES[name][1])[0]  # compilers have done their work after it
            submit(farm, name, {**inputs, "video": farm.assets.add(warm, warm.name).id})
            _run(farm, renderer)
            print("  recorded run:", flush=True)
            job = submit(farm, name, inputs)
            timed, dispatch_s = _run(farm, renderer)
        state = farm.jobs.get(job)
        farm.stop()
    if state.state != "succeeded":
        raise SystemExit(f"The job {state.state}: {state.error}")
    steps = tuple(step.name for step in state.steps)
    return Recorded(name, CLIP, SIZES[name][0], size, steps, dispatch_s, tuple(timed))


def submit(farm: Any, name: str, inputs: dict[str, str]) -> str:
    from workers.contract.request import JobRequest

    return str(farm.jobs.submit(JobRequest(name, inputs)).id)


def _run(farm: Any, renderer: Any) -> tuple[list[TimedTask], float]:
    """Run the job; its tasks, and the median cost of their claims and outcomes, seconds."""
    from workers.scheduling.in_turn import run_in_turn

    timed, costs = [], []
    for run in run_in_turn(farm.store, renderer):
        order = run.order
        if run.outcome.fault is not None:
            raise SystemExit(f"{order.step}/{order.key}: {run.outcome.fault}\n{run.outcome.log}")
        costs.append(run.database_s)
        after = tuple(name for name in order.after if "/" not in name)
        timed.append(TimedTask(run.step, order.key, round(run.seconds, 4), after))
        print(f"    {order.step}/{order.key}: {run.seconds:.2f} s", flush=True)
    return timed, round(sorted(costs)[len(costs) // 2], 5)


def short(folder: Path, frames: int, width: int) -> tuple[Path, tuple[int, int]]:
    """Write the first frames of the film at a small size."""
    import av

    from benchmarks.loops import source

    path = folder / f"small-{frames}.mp4"
    with av.open(str(source(CLIP, "640x272", folder))) as given, av.open(str(path), "w") as out:
        height = round(width * given.streams.video[0].height / given.streams.video[0].width / 2) * 2
        stream = out.add_stream("libx264", rate=given.streams.video[0].average_rate)
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        for number, frame in enumerate(given.decode(video=0)):
            if number == frames:
                break
            out.mux(stream.encode(frame.reformat(width, height, "yuv420p", interpolation="AREA")))
        out.mux(stream.encode(None))
    return path, (width, height)


def style_of(name: str) -> Path | None:
    """A painting for the method that requires one."""
    from benchmarks.clips import MEDIA

    if name != "analogy":
        return None
    return next(iter(sorted((MEDIA.parent / "style" / STYLE).glob("*.[jp][pn]g"))), None)


# -- the table


def main() -> None:
    """Print the table; with `record`, record the jobs first."""
    if "record" in sys.argv:
        for name in sys.argv[sys.argv.index("record") + 1 :] or METHODS:
            print(name)
            RECORDED.mkdir(exist_ok=True)
            (RECORDED / f"{name}.json").write_text(json.dumps(asdict(record(name)), indent=1) + "\n")
        return
    print(EXTRAPOLATED)
    print("| method | film | tasks | alone | " + " | ".join(map(str, WORKERS)) + " | with 512, the limit is |")
    print("|---|---|---|---|" + "---|" * (len(WORKERS) + 1))
    for name in METHODS:
        if (RECORDED / f"{name}.json").is_file():
            for clips in FILMS:
                print(_row(film(larger(load(name), FILM_WIDTH_PX), clips)))


def load(name: str) -> Recorded:
    """Read a recording of the repository."""
    given = json.loads((RECORDED / f"{name}.json").read_text())
    tasks = tuple(TimedTask(**{**task, "after": tuple(task["after"])}) for task in given.pop("tasks"))
    return Recorded(**{**given, "size": tuple(given["size"]), "steps": tuple(given["steps"]), "tasks": tasks})


def _row(job: Recorded) -> str:
    alone = simulate(job, 1)
    runs = [explain(job, workers) for workers in WORKERS]
    speeds = " | ".join(f"{alone / run.seconds:.1f}" for run in runs)
    size = f"{job.frames:,} frames | {len(job.tasks):,} | {alone / 3600:.2f} h"
    return f"| {job.method} | {size} | {speeds} | {runs[-1].limit} |"


if __name__ == "__main__":
    main()
