"""Features that tasks prepare for a chain: how far they run ahead, when they pay, and the bytes that come of them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pipeline.methods import method
from pipeline.methods.base import Task
from pipeline.methods.local import LocalContext, run_plan
from pipeline.methods.multistyle import backward_flow
from pipeline.methods.multistyle.params import MultistyleParams
from pipeline.methods.plan_check import check_plan
from pipeline.methods.prepared import LEAD, MOST_BYTES, costs_more, with_prepared
from pipeline.scenes import scene

MULTISTYLE = method("multistyle")
SIZE = (96, 72)


def _chain(*shots: int, frames: int = 10) -> list[Task]:
    """Chains of so many runs, one after another."""
    tasks: list[Task] = []
    for runs in shots:
        for run in range(runs):
            start = frames * len(tasks)
            after = (tasks[-1].key,) if run else ()
            tasks.append(Task(f"run-{start}", {"start": start, "stop": start + frames}, after))
    return tasks


def test_each_run_waits_for_its_features_and_these_for_a_run_at_most_so_far_behind() -> None:
    groups = with_prepared(_chain(7, 2), "flow", 0.5, 100)
    tasks = {task.key: task for group in groups for task in group}
    check_plan(list(tasks.values()), "paint", {}, ["paint"])
    assert [group[-1].key for group in groups] == [f"run-{start}" for start in range(0, 90, 10)]
    for place in range(9):
        start, first = 10 * place, place in (0, 7)
        before = () if first else (f"run-{start - 10}",)
        assert tasks[f"run-{start}"].after == (*before, f"flow-{start:07d}")
        far = place - LEAD
        waits = (f"run-{10 * far}",) if far >= (0 if place < 7 else 7) else ()
        assert tasks[f"flow-{start:07d}"].after == waits, "shots do not wait for each other"
        assert tasks[f"flow-{start:07d}"].args == {"start": start, "stop": start + 10, "first": first}
        assert tasks[f"flow-{start:07d}"].weight == 5


def test_large_features_run_less_far_ahead_but_always_two_runs() -> None:
    for frame_bytes, lead in ((MOST_BYTES // 30, 3), (MOST_BYTES, 2), (1, LEAD)):
        tasks = {task.key: task for group in with_prepared(_chain(9), "flow", 1, frame_bytes) for task in group}
        assert tasks["flow-0000080"].after == (f"run-{10 * (8 - lead)}",)


def test_features_are_prepared_only_if_they_cost_more_than_to_keep_them() -> None:
    assert costs_more(1e6, 0, 0) and costs_more(1e7, 1 << 20, 1 << 20)
    assert not costs_more(1e6, 1 << 20, 0) and not costs_more(1e6, 0, 1 << 20)
    prepared = {flow: backward_flow.is_prepared(MultistyleParams(flow=flow), (1280, 720)) for flow in
                ("dis-ultrafast", "dis-fast", "dis-medium", "tvl1")}  # fmt: skip
    assert prepared == {"dis-ultrafast": False, "dis-fast": False, "dis-medium": True, "tvl1": True}
    assert not backward_flow.is_prepared(MultistyleParams(temporal="off"), SIZE)


@pytest.mark.parametrize("values", [{}, {"renderer": "explicit"}, {"cut_sensitivity": 0}], ids=str)
def test_prepared_motion_gives_the_same_bytes_and_is_estimated_once(
    values: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pipeline.methods.multistyle.plan.RUN_FRAMES", 3)
    shot = scene("harbour", size=SIZE, frames=11)
    video = [picture.image for picture in shot]
    pictures, counts = [], []
    estimate = backward_flow.estimate
    for prepared, order in ((False, None), (True, None), (True, 1), (True, 2)):
        made: list[int] = []
        monkeypatch.setattr(backward_flow, "estimate", lambda *args, made=made: made.append(1) or estimate(*args))
        monkeypatch.setattr("pipeline.methods.multistyle.plan.is_prepared", lambda *given, use=prepared: use)
        context = LocalContext(MultistyleParams(**values), video, seed=3)
        keys = [task.key for task in run_plan(MULTISTYLE, context, shuffle=order)["paint"]]
        assert any(key.startswith("flow") for key in keys) == prepared
        pictures.append(np.stack([context.emitted[number] for number in range(11)]))
        counts.append(len(made))
    assert all(np.array_equal(picture, pictures[0]) for picture in pictures)
    assert counts == [10, 10, 10, 10]
