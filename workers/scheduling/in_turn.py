"""Runs the tasks of a store's jobs one after another in this process, as a dispatcher with one worker does: to measure
them, and to plan a job whose later steps depend on what an earlier one finds.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass

from workers.contract.order import TaskOrder, TaskOutcome
from workers.execution.renderer import Renderer
from workers.scheduling.orders import Orders
from workers.scheduling.step_planner import StepPlanner
from workers.store import Store

_LEASE_S = 3600.0


@dataclass(frozen=True)
class TaskRun:
    """One task that has run.

    Attributes:
        step: number of its step.
        seconds: processor time of this process while it ran.
        database_s: processor time of its claim and its outcome.
    """

    step: int
    order: TaskOrder
    outcome: TaskOutcome
    seconds: float
    database_s: float


def run_in_turn(store: Store, renderer: Renderer) -> Iterator[TaskRun]:
    """Plan and run what is due, until nothing is left. No other process may run the jobs of the store. A step is
    planned when the iterator is advanced after the last task of the step before it."""
    orders, queue, planner = Orders(store, shares_memory=False), store.queue, StepPlanner(store)
    while True:
        while planner.plan():
            pass
        began = time.process_time()
        claim = queue.claim("in-turn", _LEASE_S)
        claimed_s = time.process_time() - began
        if claim is None:
            return
        order = orders.order(claim)
        began = time.process_time()
        outcome = renderer.run(order)
        seconds = time.process_time() - began
        began = time.process_time()
        queue.finish(outcome)
        yield TaskRun(claim.task["step"], order, outcome, seconds, claimed_s + time.process_time() - began)
