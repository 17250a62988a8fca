"""Replay of a job's tasks on any number of processors: how long it takes, and which chain of tasks takes longest.

The replay follows the dispatchers. Steps run one after the other. A task is ready when the tasks that it depends on are
done; ready tasks begin in plan order while processors are idle. Each begin costs a claim and an outcome, which the
database serialises. A task may keep several processors busy with its threads: running tasks share the processors in
proportion to what they can use.

`impasto render --explain` replays the plan of a film with estimated seconds, `python -m benchmarks speedup` one with
measured seconds.
"""

from __future__ import annotations

import heapq
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

PROCESSORS = (1, 2, 4, 8, 16, 64)
"""Numbers of processors that reports show."""
DISPATCH_S = 0.012
"""Seconds of database work of a task: one claim and one outcome (SQLite, docs/measurements/farm.md)."""
_ROUNDING_S = 1e-9


@dataclass(frozen=True)
class TimedTask:
    """A task with its cost.

    Attributes:
        step: number of its step.
        key: unique in its step.
        seconds: processor time of all its threads.
        after: keys of tasks of the same step that must be done first.
        threads: processors that it can keep busy on average, at least 1: `seconds` divided by the processor time of its
            busiest thread.
    """

    step: int
    key: str
    seconds: float
    after: tuple[str, ...] = ()
    threads: float = 1.0

    @property
    def shortest_s(self) -> float:
        """Seconds that it takes on a machine with idle processors."""
        return self.seconds / self.threads


def replayed(tasks: Sequence[TimedTask], processors: int, dispatch_s: float = DISPATCH_S) -> float:
    """Seconds from the first claim to the last outcome on that many processors."""
    now = 0.0
    for mine in by_step(tasks).values():
        now = _Step(mine, processors, dispatch_s, now).run()
    return now


def critical_path(tasks: Sequence[TimedTask]) -> list[TimedTask]:
    """The chain of tasks that takes longest on a machine with idle processors, through all steps, in order. No number
    of processors makes the job faster than the sum of their `shortest_s`."""
    return [task for mine in by_step(tasks).values() for task in _longest_chain(mine)]


def by_step(tasks: Sequence[TimedTask]) -> Mapping[int, list[TimedTask]]:
    """The tasks of each step, in the order of the steps."""
    found: dict[int, list[TimedTask]] = defaultdict(list)
    for task in tasks:
        found[task.step].append(task)
    return dict(sorted(found.items()))


def _longest_chain(tasks: Sequence[TimedTask]) -> list[TimedTask]:
    """Tasks of one step in an order in which each comes after those that it depends on."""
    ends: dict[str, float] = {}
    before: dict[str, TimedTask | None] = {}
    known = {task.key: task for task in tasks}
    waiting = list(tasks)
    while waiting:
        ready = [task for task in waiting if all(key in ends for key in task.after)]
        for task in ready:
            latest = max(task.after, key=lambda key: ends[key], default=None)
            before[task.key] = None if latest is None else known[latest]
            ends[task.key] = task.shortest_s + (0.0 if latest is None else ends[latest])
        waiting = [task for task in waiting if task.key not in ends]
    at: TimedTask | None = known[max(ends, key=lambda key: ends[key])] if ends else None
    chain: list[TimedTask] = []
    while at is not None:
        chain.append(at)
        at = before[at.key]
    return chain[::-1]


@dataclass
class _Running:
    """A task that has begun: it does work from `begins_s` on."""

    place: int
    begins_s: float
    left_s: float


class _Step:
    """The replay of one step from `now` on."""

    def __init__(self, tasks: Sequence[TimedTask], processors: int, dispatch_s: float, now: float) -> None:
        self._tasks, self._processors, self._dispatch_s = tasks, processors, dispatch_s
        self._now = self._database = now
        self._order = {task.key: place for place, task in enumerate(tasks)}
        self._blockers = {task.key: len(set(task.after)) for task in tasks}
        self._waiting_for: dict[str, list[str]] = defaultdict(list)
        for task in tasks:
            for key in set(task.after):
                self._waiting_for[key].append(task.key)
        self._ready = [self._order[key] for key, count in self._blockers.items() if not count]
        heapq.heapify(self._ready)
        self._running: list[_Running] = []

    def run(self) -> float:
        """The end of the last task, seconds."""
        while self._ready or self._running:
            while self._ready and self._busy() < self._processors:
                self._begin(heapq.heappop(self._ready))
            self._advance()
        return self._now

    def _busy(self) -> float:
        return sum(self._tasks[each.place].threads for each in self._running)

    def _begin(self, place: int) -> None:
        self._database = max(self._database, self._now) + self._dispatch_s
        self._running.append(_Running(place, self._database, self._tasks[place].seconds))

    def _advance(self) -> None:
        """Let the running tasks work until one of them begins or ends."""
        working = [each for each in self._running if each.begins_s <= self._now + _ROUNDING_S]
        wanted = sum(self._tasks[each.place].threads for each in working)
        share = min(1.0, self._processors / wanted) if wanted else 0.0
        rates = {each.place: self._tasks[each.place].threads * share for each in working}
        events = [each.left_s / rates[each.place] for each in working]
        events += [each.begins_s - self._now for each in self._running if each.place not in rates]
        elapsed = min(events)
        self._now += elapsed
        for each in working:
            each.left_s -= elapsed * rates[each.place]
            if each.left_s <= _ROUNDING_S:
                self._running.remove(each)
                self._end(each.place)

    def _end(self, place: int) -> None:
        for key in self._waiting_for[self._tasks[place].key]:
            self._blockers[key] -= 1
            if not self._blockers[key]:
                heapq.heappush(self._ready, self._order[key])
