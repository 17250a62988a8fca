"""The cost of each route is within its budget, at 20,000 jobs as at 5,000: counted, not timed."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from sqlalchemy import update

from pipeline.methods.base import Task
from service.app import ROUTERS
from tests.costs.budgets import READS, UNMEASURED, WRITES, Ask
from tests.costs.filling import ASSET, Size
from tests.costs.measuring import Measured, measured
from workers.contract.order import TaskOutcome
from workers.contract.request import JobRequest
from workers.store import Accepted, schema

SMALL, LARGE = Size(5000, 250, 2500), Size(20_000, 1000, 10_000)
GROWTH, FREE_STEPS = 1.3, 3000
"""A flat request visits about as many rows in the large store: at most this factor and this number more steps."""


@pytest.fixture(scope="module")
def stores(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Measured, Measured]]:
    small, large = (tmp_path_factory.mktemp(name) for name in ("small", "large"))
    with measured(small, SMALL) as few, measured(large, LARGE) as many:
        yield few, many


@pytest.mark.parametrize("ask", [*READS, *WRITES], ids=lambda ask: f"{ask.request} {ask.who}")
def test_a_request_stays_within_its_budget(ask: Ask, stores: tuple[Measured, Measured]) -> None:
    few, many = (store.cost(ask, repeats=1) for store in stores)
    assert few.status == many.status < 500
    assert many.queries <= ask.queries, "more queries than its row in tests/costs/budgets.py allows"
    if ask.growth == "flat":
        assert many.steps <= GROWTH * few.steps + FREE_STEPS, f"{few.steps} steps at 5,000 jobs: it scans a table"


def test_every_route_has_a_budget() -> None:
    routes = (route for router in ROUTERS for route in router.routes)
    offered = {f"{verb} {route.path}" for route in routes for verb in getattr(route, "methods", None) or ()}  # type: ignore[attr-defined]
    known = {ask.route for ask in (*READS, *WRITES)} | UNMEASURED
    assert {route for route in offered if not route.startswith("HEAD ")} == known, "add a row to tests/costs/budgets.py"


def test_a_second_owners_job_begins_within_three_tasks(stores: tuple[Measured, Measured]) -> None:
    """One slot, and 8,000 waiting jobs of another owner among 20,000: the plan and the first task come at once."""
    store = stores[1].farm.store
    with store.database.write() as connection:
        connection.execute(update(schema.jobs).values(owner="anna"))
    store.queue.interrupt(["dsp_1"])

    def work() -> str:
        """What a dispatcher with one slot does; returns the job whose task it has run."""
        for todo in store.plans.to_plan():
            store.plans.planned(todo.job_id, todo.step, [Task("t")])
        claim = store.queue.claim("dsp_2", 60.0)
        assert claim is not None
        assert store.queue.finish(TaskOutcome(claim.attempt_id, {}, {}, {}, None, {}, ""))
        return claim.job_id

    for _ in range(20):
        work()
    bens = store.jobs.add(Accepted(JobRequest("multistyle", {"video": ASSET}), {}, (("scan", "Scan"),)), "ben").id
    assert bens in [work() for _ in range(3)]
