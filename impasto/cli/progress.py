"""A job's progress on stderr: a bar for each step and the time left on a terminal, a line a step elsewhere."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn

from impasto.cli.console import err, print_status
from workers.model import Json

Show = Callable[[Json], None]
"""Shows a job, given as the API's JSON object: at least `state`, `progress`, `eta_s` and `steps`."""


@contextmanager
def progress(quiet: bool = False) -> Iterator[Show]:
    """A function that shows a job; call it after each change."""
    if quiet:
        yield lambda job: None
    elif err.is_terminal:
        with _bars() as bars:
            yield _Bars(bars).show
    else:
        yield _Lines().show


def _bars() -> Progress:
    return Progress(
        TextColumn("{task.description}", justify="right"),
        BarColumn(bar_width=36, complete_style="bright_magenta", finished_style="green", pulse_style="magenta"),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeElapsedColumn(),
        TextColumn("[dim]{task.fields[note]}"),
        console=err,
    )


class _Bars:
    """A progress bar for each step, and one for the job with the remaining time."""

    def __init__(self, bars: Progress) -> None:
        self._bars = bars
        self._whole = bars.add_task("[bold]job", total=1.0, detail="")
        self._steps: dict[str, TaskID] = {}

    def show(self, job: Json) -> None:
        for step in job["steps"]:
            self._step(step)
        self._bars.update(self._whole, completed=job["progress"], detail=_left(job))

    def _step(self, step: Json) -> None:
        bar = self._steps.get(step["name"])
        if bar is None:
            bar = self._steps[step["name"]] = self._bars.add_task(_title(step), total=1.0, start=False, detail="")
        if step["state"] != "waiting":
            self._bars.start_task(bar)
        self._bars.update(bar, completed=step["progress"], detail=_tasks(step))


class _Lines:
    """For logs and pipes: one line when a step starts and one when it ends."""

    def __init__(self) -> None:
        self._states: dict[str, str] = {}

    def show(self, job: Json) -> None:
        for step in job["steps"]:
            before, now = self._states.get(step["name"], "waiting"), step["state"]
            self._states[step["name"]] = now
            if now != before:
                print_status(f"{_title(step)}: {now}" + (f", {_tasks(step)}" if _tasks(step) else ""))


def _title(step: Json) -> str:
    return str(step["title"] or step["name"])


def _tasks(step: Json) -> str:
    total = sum(step["counts"].values())
    return f"{step['counts'].get('succeeded', 0)} of {total} tasks" if total > 1 else ""


def _left(job: Json) -> str:
    """The remaining time if it is known, else the state."""
    if job["state"] != "running" or job["eta_s"] is None:
        return str(job["state"])
    return f"{duration(job['eta_s'])} left"


def duration(seconds: float) -> str:
    """A duration as text: "8 s", "3 min 20 s", "1 h 05 min"."""
    whole = max(0, round(seconds))
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"
