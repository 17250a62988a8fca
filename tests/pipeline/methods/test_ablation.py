"""The list of corrections that `benchmarks.ablation` switches off."""

from __future__ import annotations

import pytest

from benchmarks.ablation import CORRECTIONS, changes, without
from pipeline.methods.multistyle import stroke_layers


@pytest.mark.parametrize("method", CORRECTIONS)
def test_every_correction_can_be_switched_off(method: str) -> None:
    """A renamed function or constant fails here, not after an hour of renders."""
    for correction in CORRECTIONS[method]:
        with without(correction):
            pass


def test_a_constant_has_its_value_again_afterwards() -> None:
    memory = stroke_layers.LAYERS.error_memory
    with without(next(each for each in CORRECTIONS["multistyle"] if each.name == "error_memory")):
        assert stroke_layers.LAYERS.error_memory == 0
    assert stroke_layers.LAYERS.error_memory == memory


def test_measures_change_by_per_cent_and_faces_by_points_of_all_clips() -> None:
    same = {"detail": "1", "structure": "1", "eyes": "0/0", "edge_px": "1.5", "flat": "0.5", "cpu_ms": "9"}
    rows = [
        same | {"clip": clip, "without": without, "flicker": flicker, "faces": faces, "difference": "1"}
        for clip, without, flicker, faces in (
            ("a", "all on", "1", "6/8"), ("a", "x", "1.1", "5/8"), ("b", "all on", "2", "2/2"), ("b", "x", "2", "2/2"),
        )
    ]  # fmt: skip
    found = changes(rows, "x")
    assert found["flicker"] == pytest.approx(5)
    assert found["faces"] == pytest.approx(-10)
    assert (found["clips"], found["eyes"]) == (2, 0)
