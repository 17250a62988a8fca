"""`impasto.render` of arrays of each type, with and without opacity; its progress, and how it is ended."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import av
import numpy as np
import pytest
from numpy.typing import NDArray

import impasto
from pipeline.arrays import AnyArray
from pipeline.video.depth import as_float, as_uint16
from tests.conftest import TINY_FRAMES, tiny_frame

FRAMES = [tiny_frame(index) for index in range(4)]
OPTIONS = {"abstraction": {"lines": "off"}, "steady": {"preset": "light"}}


def opacity() -> NDArray[np.uint8]:
    """A ramp from clear to opaque."""
    return np.broadcast_to(np.linspace(0, 255, 96).astype(np.uint8), (64, 96)).copy()


def given(kind: str) -> list[AnyArray]:
    """The frames as uint8, uint16, float32 or float64."""
    scale = {"uint8": 1, "uint16": 257}.get(kind, 1 / 255)
    return [(frame * np.float64(scale)).astype(kind) for frame in FRAMES]


@pytest.mark.parametrize("kind", ["uint16", "float32", "float64"])
@pytest.mark.parametrize("method", ["abstraction", "patches"])
def test_frames_come_back_in_the_type_of_the_arrays(method: str, kind: str) -> None:
    options = OPTIONS.get(method, {})
    plain = list(impasto.render(method, FRAMES, **options))
    found = list(impasto.render(method, given(kind), **options))
    assert {frame.dtype.name for frame in found} == {"float32" if kind == "float64" else kind}
    convert, white = (as_uint16, 65535) if kind == "uint16" else (as_float, 1)
    for one, other in zip(found, plain, strict=True):
        error = np.abs(one.astype(np.float64) - convert(other)) * 255 / white
        assert error.max() == 0 if method == "abstraction" else 0 < error.mean() < 1, "patches compute 16 bits"


@pytest.mark.parametrize("method", ["abstraction", "patches"])
def test_opacity_comes_back_unchanged(method: str) -> None:
    clear = opacity()
    with_opacity = [np.dstack([frame, clear]) for frame in FRAMES]
    found = list(impasto.render(method, with_opacity, **OPTIONS.get(method, {})))
    assert all(frame.shape == (64, 96, 4) and np.array_equal(frame[..., 3], clear) for frame in found)
    plain = list(impasto.render(method, FRAMES, **OPTIONS.get(method, {})))
    opaque = clear > 0
    assert np.abs(found[0][..., :3][opaque].astype(int) - plain[0][opaque]).mean() < 2, (
        "colours are those of the arrays"
    )


def test_a_deep_method_computes_more_than_8_bits_of_floats() -> None:
    ramp = np.broadcast_to(np.linspace(0.2, 0.6, 512, dtype=np.float32)[None, :, None], (32, 512, 3)).copy()
    (frame,) = impasto.render("steady", [ramp], inputs={"styled": [ramp]})
    assert frame.dtype == np.float32 and len(np.unique(frame)) > 256
    assert np.abs(frame - ramp).max() < 1 / 1024


def test_gray_arrays_are_accepted() -> None:
    (frame,) = impasto.render("abstraction", [np.full((32, 32), 90, np.uint8)], lines="off")
    assert frame.shape == (32, 32, 3)


@pytest.mark.parametrize(("name", "kept"), [("out.png", True), ("out.mp4", False)])
def test_opacity_is_in_formats_that_have_it(name: str, kept: bool, tmp_path: Path) -> None:
    clear = opacity()
    impasto.render("abstraction", [np.dstack([FRAMES[0], clear])], tmp_path / name, lines="off", quality=0)
    with av.open(str(tmp_path / name)) as file:
        pixels = next(file.decode(video=0)).to_ndarray(format="rgba")
    assert np.array_equal(pixels[..., 3], clear if kept else np.full_like(clear, 255))
    left = pixels[:, :4, :3]
    assert (left.mean() > 225) != kept, "a format without opacity shows the picture over white"


def test_floats_with_white_at_255_are_refused() -> None:
    with pytest.raises(impasto.BadFrame, match="white at 1") as caught:
        list(impasto.render("abstraction", [frame.astype(np.float32) for frame in FRAMES]))
    assert caught.value.field == "source[0]"


def test_arrays_of_two_types_are_refused() -> None:
    with pytest.raises(impasto.BadFrame, match="one type") as caught:
        list(impasto.render("abstraction", [given("uint8")[0], given("uint16")[1]]))
    assert caught.value.field == "source[1]"


@pytest.mark.parametrize("method", ["abstraction", "patches"])
@pytest.mark.parametrize("source", ["file", "arrays"])
def test_progress_grows_from_0_to_1(method: str, source: str, tiny_clip: Path, tmp_path: Path) -> None:
    shares: list[float] = []
    video = tiny_clip if source == "file" else FRAMES
    impasto.render(method, video, tmp_path / "out.mp4", progress=shares.append, **OPTIONS.get(method, {}))
    assert shares == sorted(shares) and shares[0] < 0.5 and shares[-1] == pytest.approx(1)
    assert len(shares) >= (TINY_FRAMES if source == "file" else len(FRAMES))


def test_frames_of_an_iterator_without_a_length_have_no_progress() -> None:
    shares: list[float] = []

    def frames() -> Iterator[AnyArray]:
        yield from FRAMES

    assert len(list(impasto.render("abstraction", frames(), progress=shares.append, lines="off"))) == len(FRAMES)
    assert shares == []


class Stop(Exception):
    pass


@pytest.mark.parametrize("method", ["abstraction", "patches"])
def test_an_exception_of_progress_ends_the_render_and_leaves_nothing(
    method: str, tiny_clip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))

    def stop(share: float) -> None:
        if share > 0.2:
            raise Stop

    with pytest.raises(Stop):
        impasto.render(method, tiny_clip, tmp_path / "out.mp4", progress=stop, **OPTIONS.get(method, {}))
    assert list(tmp_path.iterdir()) == []
