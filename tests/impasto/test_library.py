"""`impasto.render` from Python: arrays and files, causal and planned methods, the same frames as the command."""

from __future__ import annotations

import doctest
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pytest

import impasto
import impasto.library
from impasto.cli.app import run
from pipeline.errors import BadFrame, BadInput, BadParameter
from pipeline.frames import Frame
from tests.conftest import TINY_FRAMES, TINY_HEIGHT, TINY_WIDTH, tiny_frame


def frames_of(path: Path) -> list[Frame]:
    with av.open(str(path)) as clip:
        return [np.asarray(frame.to_ndarray(format="rgb24"), np.uint8) for frame in clip.decode(video=0)]


def arriving(count: int, consumed: list[int]) -> Iterator[Frame]:
    """Frames that record when they are consumed."""
    for index in range(count):
        consumed.append(index)
        yield tiny_frame(index)


def test_docstring_examples_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    flags = doctest.ELLIPSIS | doctest.IGNORE_EXCEPTION_DETAIL
    found = doctest.testmod(impasto.library, optionflags=flags)
    assert (found.failed, found.attempted > 5) == (0, True)


def test_a_causal_method_gives_each_frame_before_it_reads_the_next() -> None:
    consumed: list[int] = []
    painted = impasto.render("abstraction", arriving(5, consumed), lines="off")
    assert consumed == []
    for index in range(5):
        assert next(painted).shape == (TINY_HEIGHT, TINY_WIDTH, 3)
        assert consumed[-1] == index
    assert list(painted) == []


@pytest.mark.parametrize("method", ["patches", "analogy"])
def test_non_causal_methods_run_their_plan(method: str, tmp_path: Path) -> None:
    style = np.random.default_rng(1).integers(0, 255, (48, 64, 3), np.uint8)
    inputs = {"style_output": style} if method == "analogy" else {}
    clip = [tiny_frame(index) for index in range(4)]
    painted = list(impasto.render(method, iter(clip), inputs=inputs, seed=3))
    again = list(impasto.render(method, clip, inputs=inputs, seed=3))
    assert len(painted) == len(again) == 4
    assert all(np.array_equal(one, other) for one, other in zip(painted, again, strict=True))
    assert not np.array_equal(painted[0], clip[0])


@pytest.mark.parametrize("method", ["abstraction", "patches"])
def test_a_file_gives_the_frames_of_the_command(tiny_clip: Path, tmp_path: Path, home: Path, method: str) -> None:
    words = ["render", str(tiny_clip), "-o", f"{tmp_path}/command/", "-m", method, "--seed", "2", "--home", str(home)]
    assert run([*words, "--quiet"]) == 0
    path = impasto.render(method, tiny_clip, f"{tmp_path}/library/", seed=2)
    assert path == tmp_path / "library"
    names = [f"{index:04d}.png" for index in range(TINY_FRAMES)]
    assert sorted(file.name for file in path.iterdir()) == names
    for name in names:
        one, other = (cv2.imread(str(tmp_path / folder / name)) for folder in ("command", "library"))
        assert np.array_equal(one, other), name


def test_a_video_keeps_times_and_sound(tiny_clip: Path, tmp_path: Path) -> None:
    path = impasto.render("abstraction", tiny_clip, tmp_path / "out.mp4", lines="off")
    assert len(frames_of(path)) == TINY_FRAMES
    with av.open(str(path)) as made, av.open(str(tiny_clip)) as source:
        assert len(made.streams.audio) == len(source.streams.audio) == 1
        assert made.streams.video[0].average_rate == source.streams.video[0].average_rate


def test_inputs_and_existing_outputs_are_not_overwritten(tiny_clip: Path, tmp_path: Path) -> None:
    clip = tmp_path / "clip.mp4"
    clip.write_bytes(tiny_clip.read_bytes())
    with pytest.raises(BadInput, match="is an input"):
        impasto.render("abstraction", clip, clip, overwrite=True)
    (tmp_path / "there.mp4").write_text("mine")
    with pytest.raises(BadInput, match="exists"):
        impasto.render("abstraction", clip, tmp_path / "there.mp4")


def test_errors_are_raised_before_the_first_frame(tiny_clip: Path) -> None:
    with pytest.raises(BadParameter, match="Did you mean 'abstraction'"):
        impasto.render("abstracton", tiny_clip)
    with pytest.raises(BadParameter, match="Did you mean 'reference'"):
        impasto.render("abstraction", tiny_clip, inputs={"refernce": tiny_clip})
    with pytest.raises(BadParameter, match="Did you mean 'lines'"):
        impasto.render("abstraction", tiny_clip, line="off")
    with pytest.raises(BadParameter, match="'style' needs the input 'style_output'"):
        impasto.render("analogy", tiny_clip, inputs={"style": tiny_clip})


@pytest.mark.parametrize(
    "array", [np.zeros((40, 40, 3), bool), np.zeros((40, 40, 2), np.uint8), np.zeros((8, 40, 3), np.uint8), "pixels"]
)
def test_an_array_of_the_wrong_shape_is_named_in_the_error(array: object) -> None:
    with pytest.raises(BadFrame) as caught:
        next(impasto.render("abstraction", [array]))  # type: ignore[list-item]
    assert caught.value.field == "source[0]"


def test_frames_of_two_sizes_are_refused() -> None:
    painted = impasto.render("abstraction", [np.zeros((40, 40, 3), np.uint8), np.zeros((40, 48, 3), np.uint8)])
    next(painted)
    with pytest.raises(BadFrame, match="one size"):
        next(painted)


@pytest.mark.parametrize(
    ("file", "given", "unused"),
    [
        (False, {"quality": 3}, "quality"), (False, {"overwrite": True}, "overwrite"), (True, {"fps": 10}, "fps"),
        (False, {"output": "out.mov", "quality": 3}, "quality"), (False, {"output": "out.mp4", "quality": 3}, ""),
        (False, {"fps": 10}, ""),
    ],
)  # fmt: skip
def test_arguments_without_effect_are_told(
    file: bool, given: dict[str, Any], unused: str, tiny_clip: Path, tmp_path: Path
) -> None:
    frames = [np.full((48, 64, 3), 90, np.uint8)]
    if "output" in given:
        given = {**given, "output": tmp_path / given["output"]}
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        impasto.render("abstraction", tiny_clip if file else frames, **given)
    told = [str(one.message) for one in found if one.category is impasto.NoEffect]
    assert told == ([f"{unused} has no effect here."] if unused else [])


@pytest.mark.parametrize(
    ("given", "field"),
    [({"source": "none.mp4"}, "source"), ({"inputs": {"reference": "none.png"}}, "inputs.reference"),
     ({"seed": -1}, "seed")],
)  # fmt: skip
def test_what_is_not_there_is_refused_at_once(given: dict[str, Any], field: str) -> None:
    source = given.pop("source", [np.full((48, 64, 3), 90, np.uint8)])
    with pytest.raises(impasto.BadInput) as error:
        impasto.render("abstraction", source, **given)
    assert error.value.field == field
