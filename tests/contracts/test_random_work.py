"""Random commands, crashes, late answers and clock steps on a whole store, against a simple model.

After every step all jobs equal the model's; after every fifth one, and at the end, `validate_state` finds nothing.
`IMPASTO_FARM_STEPS` sets the number of steps on SQLite (PostgreSQL makes a quarter): ten thousand in CI, twenty
thousand by `make chaos`. `test_random_work_finds_a_broken_rule` breaks rules of the store one by one: the machine must
notice each.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import NamedTuple

import pytest
from hypothesis import HealthCheck, Phase, seed, settings
from hypothesis.errors import Flaky
from hypothesis.stateful import run_state_machine_as_test

from tests.contracts.farm_machine import MAX_RUNNING, FarmMachine
from tests.contracts.farm_model import MAX_FAILURES, MAX_INTERRUPTIONS, RETRY_DELAY_S
from tests.contracts.mutations import MUTATIONS, Mutation
from tests.real.postgres import Postgres
from workers.errors import Conflict
from workers.jobs import state_machine as machine
from workers.store import Store, StorePolicy

STEPS = int(os.environ.get("IMPASTO_FARM_STEPS", "800"))
STEPS_AT_ONCE = 50
REPEATABLE_STEPS = 10_000
"""Runs of at most this many steps are the same each time; longer ones draw other numbers in each run."""
MUTATIONS_IN_CI = 6


class Counted(NamedTuple):
    """Counts of a run."""

    steps: int
    states: set[str]
    """States that jobs have reached."""
    superseded: int
    """Late answers of attempts whose task had another running attempt."""


def _run(url: str, folder: Path, steps: int, shrink: bool = True, start: int | None = None) -> Counted:
    """Run about `steps` steps; with `start`, those of this seed."""
    clock = [10_000.0]
    limits = machine.Limits(MAX_FAILURES, MAX_INTERRUPTIONS)
    store = Store(url, StorePolicy(limits, RETRY_DELAY_S, owner_tasks=MAX_RUNNING), lambda: clock[0])
    members = {"store": store, "folder": folder, "clock": clock, "ends": set()}
    made = type("Machine", (FarmMachine,), members)
    if start is not None:
        made = seed(start)(made)
    chosen = settings(
        max_examples=max(1, steps // STEPS_AT_ONCE), stateful_step_count=STEPS_AT_ONCE, deadline=None, database=None,
        derandomize=steps <= REPEATABLE_STEPS, suppress_health_check=list(HealthCheck), report_multiple_bugs=False,
        phases=[Phase.generate, Phase.shrink] if shrink else [Phase.generate],
    )  # fmt: skip
    try:
        run_state_machine_as_test(made, settings=chosen)
    finally:
        store.close()
    return Counted(made.steps, made.ends, made.superseded)


def test_random_work_on_sqlite(tmp_path: Path) -> None:
    done = _run(f"sqlite:///{tmp_path / 'impasto.db'}", tmp_path, STEPS)
    assert done.steps >= STEPS // 2 and done.states >= {"succeeded", "cancelled", "paused", "failed"}
    assert done.superseded >= STEPS // 400, "too few late answers of attempts that were replaced"


def test_random_work_on_postgresql(postgres: Postgres, tmp_path: Path) -> None:
    done = _run(postgres.fresh(), tmp_path, STEPS // 4)
    assert done.steps >= STEPS // 8 and "running" in done.states


TESTED = MUTATIONS if STEPS >= 10_000 else MUTATIONS[:MUTATIONS_IN_CI]


@pytest.mark.parametrize("mutation", TESTED, ids=lambda mutation: mutation.name)
def test_random_work_finds_a_broken_rule(mutation: Mutation, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A broken store may answer the same steps differently when Hypothesis repeats them (`Flaky`); a whole one never
    does. A seed only saves time: any other finds these rules within 2,000 steps, too."""
    mutation.apply(monkeypatch)
    start = mutation.seed if STEPS <= REPEATABLE_STEPS else None
    with pytest.raises((AssertionError, Conflict, KeyError, Flaky, pytest.fail.Exception)):
        _run(f"sqlite:///{tmp_path / 'impasto.db'}", tmp_path, max(2000, STEPS), False, start)
