"""Motion vectors: the convention is found by warping; one-way vectors are completed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.errors import BadInput
from pipeline.formats.base import PlaneImage
from pipeline.formats.exr import EXR
from pipeline.frames import Flow
from pipeline.passes.vectors import completed, of_pair, raw_vectors, vector_facts
from pipeline.scenes import scene
from pipeline.video.media import Limits
from pipeline.video.passes import picture

SIZE = (96, 64)
Written = dict[str, np.ndarray]


def shapes(index: int) -> Any:
    return scene("shapes", SIZE, frames=12, fps=12).frame(index)


def blender(plus: Flow, minus: Flow) -> Written:
    names = {"V.Vector.X": -minus[..., 0], "V.Vector.Y": minus[..., 1]}
    return names | {"V.Vector.Z": -plus[..., 0], "V.Vector.W": plus[..., 1]}


def old_eevee(plus: Flow, minus: Flow) -> Written:
    return blender(plus, -minus)


def nuke(plus: Flow, minus: Flow) -> Written:
    names = {"forward.u": plus[..., 0], "forward.v": plus[..., 1]}
    return names | {"backward.u": -minus[..., 0], "backward.v": -minus[..., 1]}


def nuke_up(plus: Flow, minus: Flow) -> Written:
    names = {"forward.u": plus[..., 0], "forward.v": -plus[..., 1]}
    return names | {"backward.u": -minus[..., 0], "backward.v": minus[..., 1]}


def arnold(plus: Flow, minus: Flow) -> Written:
    return {"motionvector.R": plus[..., 0], "motionvector.G": -plus[..., 1]}


def half_shutter(plus: Flow, minus: Flow) -> Written:
    return {"motionvector.R": plus[..., 0] / 2, "motionvector.G": -plus[..., 1] / 2}


def backward_only(plus: Flow, minus: Flow) -> Written:
    return {"motionBack.r": -minus[..., 0], "motionBack.g": minus[..., 1]}


def of_frame_sides(plus: Flow, minus: Flow) -> Written:
    return {"velocity.R": plus[..., 0] / SIZE[0], "velocity.G": plus[..., 1] / SIZE[1]}


def of_half_sides(plus: Flow, minus: Flow) -> Written:
    return {"MV.x": 2 * plus[..., 0] / SIZE[0], "MV.y": -2 * plus[..., 1] / SIZE[1]}


def image(index: int, written: Callable[[Flow, Flow], Written]) -> PlaneImage:
    """A frame's exact velocities as a renderer would write them."""
    shot = shapes(index)
    return PlaneImage(SIZE, written(shot.velocity_next, shot.velocity_previous))


def pair(written: Callable[[Flow, Flow], Written], first: int = 3) -> Any:
    return tuple((image(index, written), shapes(index).image) for index in (first, first + 1))


TWO_WAY = (blender, old_eevee, nuke, nuke_up)


@pytest.mark.parametrize("written", TWO_WAY)
def test_the_signs_of_both_directions_are_found(written: Callable[[Flow, Flow], Written]) -> None:
    first, second = pair(written)
    facts = vector_facts(first, second)
    found = of_pair(facts, first[0], second[0])
    assert facts.used and facts.way == "both" and facts.unit == "px" and facts.error < facts.still
    assert found.plus is not None and found.minus is not None
    np.testing.assert_allclose(found.plus, shapes(3).velocity_next, atol=1e-5)
    np.testing.assert_allclose(found.minus, shapes(4).velocity_previous, atol=1e-5)


@pytest.mark.parametrize(("written", "unit"), [
    (arnold, "px"), (half_shutter, "px of half a frame's time"), (of_frame_sides, "frame sides"),
    (of_half_sides, "half frame sides"),
])  # fmt: skip
def test_the_unit_of_one_way_vectors_is_found_and_the_other_direction_completed(
    written: Callable[[Flow, Flow], Written], unit: str
) -> None:
    first, second = pair(written)
    facts = vector_facts(first, second)
    plus, minus = completed(of_pair(facts, first[0], second[0]), first[1], second[1])
    assert (facts.way, facts.unit) == ("next", unit) and "completed" in facts.sentence()
    np.testing.assert_allclose(plus, shapes(3).velocity_next, atol=1e-3)
    apart = np.abs(minus - shapes(4).velocity_previous).max(-1)
    assert (apart > 0.5).mean() < 0.05  # uncovered places have no candidate


def test_vectors_to_the_previous_frame_alone_are_completed() -> None:
    first, second = pair(backward_only)
    facts = vector_facts(first, second)
    plus, minus = completed(of_pair(facts, first[0], second[0]), first[1], second[1])
    assert facts.way == "previous"
    np.testing.assert_allclose(minus, shapes(4).velocity_previous, atol=1e-5)
    assert (np.abs(plus - shapes(3).velocity_next).max(-1) > 0.5).mean() < 0.05


@pytest.mark.parametrize("convention", ["blender", "cycles", "eevee"])
def test_a_stated_convention_is_used_as_it_is(convention: str) -> None:
    first, second = pair(blender)
    facts = vector_facts(first, second, convention)
    assert facts.factors == (-1, -1, -1) and facts.stated == convention
    wrong = vector_facts(first, second, (1.0, 1.0, 1.0))
    assert wrong.factors == (1, 1, 1) and wrong.used and wrong.error > facts.error


def test_unusable_vectors_are_not_used_and_the_reason_is_told() -> None:
    def noise(plus: Flow, minus: Flow) -> Written:
        return {name: 5 * np.random.default_rng(at).normal(size=SIZE[::-1]).astype(np.float32)
                for at, name in enumerate(("motion.x", "motion.y"))}  # fmt: skip

    def coded(plus: Flow, minus: Flow) -> Written:
        return {f"MotionVectors.{c}": 0.5 + plus[..., k] / 64 for k, c in enumerate("RG")}

    for written, reason in ((noise, "without them"), (coded, "coded as colours")):
        facts = vector_facts(*pair(written))
        assert not facts.used and reason in facts.sentence()


def test_missing_vectors_and_unknown_conventions_are_refused() -> None:
    first, second = pair(blender)
    with pytest.raises(BadInput, match="convention is unknown"):
        vector_facts(first, second, "houdini")
    with pytest.raises(BadInput, match="no motion vectors"):
        vector_facts((PlaneImage(SIZE, {}), first[1]), second)


@pytest.mark.real("media")
def test_velocities_of_a_rendered_box(media: Path) -> None:
    """MANIFEST.md: exact velocities, px, y down; the box moves 6 px and more, so a wrong sign is far off."""

    def read(index: int) -> tuple[PlaneImage, np.ndarray]:
        folder = media / "cg_aov" / "box"
        image, beauty = (
            EXR.planes(folder / f"{name}_{index:03d}.exr", Limits()) for name in ("velocity", "beauty")
        )  # fmt: skip
        found = picture(beauty)
        assert found is not None
        return image, found

    facts = vector_facts(read(2), read(3))
    forth, back = raw_vectors(read(3)[0])
    assert forth is not None and back is not None and facts.used and facts.factors[2] > 0
