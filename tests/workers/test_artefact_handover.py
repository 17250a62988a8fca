"""Arrays are handed over once, as copies, and within a limit of memory."""

from __future__ import annotations

import numpy as np

from workers.execution.artefact_handover import ArtefactHandover


def test_arrays_are_taken_once_and_belong_to_the_taker() -> None:
    handover = ArtefactHandover()
    saved = {"b": np.arange(4), "a": np.ones((2, 3), np.float32).T, "count": np.int64(7)}
    handover.give("jobs/a.npz", saved)
    saved["b"][0] = 100
    taken = handover.take("jobs/a.npz")
    assert taken is not None and list(taken) == ["a", "b", "count"]
    assert taken["b"].tolist() == [0, 1, 2, 3] and taken["b"].flags.writeable
    assert taken["a"].shape == (3, 2) and taken["a"].flags.c_contiguous
    assert taken["count"].shape == () and taken["count"] == 7
    assert handover.take("jobs/a.npz") is None and handover.take("jobs/b.npz") is None


def test_arrays_that_are_read_again_stay() -> None:
    handover = ArtefactHandover(most_bytes=250)
    for name in ("a", "b"):
        handover.give(name, {"": np.zeros(100, np.uint8)})
    for _ in range(2):
        copied = handover.copy("a")
        assert copied is not None and not copied[""].any()
        copied[""][:] = 1
    handover.give("c", {"": np.zeros(100, np.uint8)})
    assert handover.copy("b") is None and handover.copy("a") is not None, "the one that was read last stays"


def test_the_oldest_arrays_are_dropped() -> None:
    handover = ArtefactHandover(most_bytes=250)
    for name in ("a", "b", "c"):
        handover.give(name, {"": np.zeros(100, np.uint8)})
    handover.give("large", {"": np.zeros(251, np.uint8)})
    assert [handover.take(name) is None for name in ("a", "b", "c", "large")] == [True, False, False, True]
    handover.give("d", {"": np.zeros(250, np.uint8)})
    assert handover.take("d") is not None, "what was taken does not count"
