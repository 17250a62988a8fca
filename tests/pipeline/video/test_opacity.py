"""Opacity of sources: over white, as colours alone, as a matte; premultiplied pictures; no fringe over a background."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np
import pytest

from pipeline.arrays import AnyArray
from pipeline.formats.base import Encoding
from pipeline.formats.exr import encode_exr
from pipeline.video.guard.reader import GuardedReader
from pipeline.video.join import join
from pipeline.video.media import SourceOptions
from pipeline.video.opacity import extended, unpremultiplied
from pipeline.video.probe import probe
from pipeline.video.reader import VideoReader
from pipeline.video.writer import SegmentSpec, segment_writer

H, W, COUNT = 96, 128, 4
Y, X = np.mgrid[:H, :W]


def disc(index: int) -> AnyArray:
    """An orange disc with a soft edge on nothing, uint8 (h, w, 4), straight."""
    clear = np.clip((30 - np.hypot(X - 55 - 4 * index, Y - 48)) / 8 + 0.5, 0, 1)
    colour = np.where(clear[..., None] > 0, (209, 76, 68), 0)
    return np.dstack([colour, np.rint(clear * 255)]).astype(np.uint8)


def premultiplied(rgba: AnyArray) -> AnyArray:
    return np.dstack([np.rint(rgba[..., :3] * (rgba[..., 3:] / 255)), rgba[..., 3]]).astype(np.uint8)


def written(folder: Path, kind: str) -> Path:
    """The discs as a source of this kind."""
    frames = [disc(index) for index in range(COUNT)]
    if kind in ("png", "premultiplied", "exr"):
        folder.joinpath(kind).mkdir()
        for index, rgba in enumerate(frames):
            name = folder / kind / f"plate.{1001 + index}"
            if kind == "exr":
                name.with_suffix(f".{1001 + index}.exr").write_bytes(encode_exr(rgba))
                continue
            stored = premultiplied(rgba) if kind == "premultiplied" else rgba
            cv2.imwrite(f"{name}.png", np.ascontiguousarray(stored[..., [2, 1, 0, 3]]))
        return folder / kind
    form, profile = {"prores": ("mov", "4444"), "vp9": ("webm", "vp9"), "ffv1": ("mkv", "ffv1"), "webp": ("webp", "")}[
        kind
    ]
    spec = SegmentSpec(form, (W, H), Fraction(1, 25), 25.0, 0, profile, alpha=True)
    with segment_writer(folder / "segment", spec) as writer:
        for index, rgba in enumerate(frames):
            writer.write(index, rgba, index, index + 1)
    join([(Fraction(0), folder / "segment")], folder / f"film.{form}", Encoding(form, 0))
    return folder / f"film.{form}"


def read(path: Path, opacity: str, multiplied: bool = False) -> AnyArray:
    options = SourceOptions(premultiplied=multiplied, opacity=opacity)  # type: ignore[arg-type]
    with VideoReader(path, options=options) as reader:
        assert reader.has_alpha
        return np.stack(list(reader.read()))


@pytest.mark.parametrize("kind", ["png", "premultiplied", "exr", "prores", "vp9", "ffv1", "webp"])
def test_a_source_with_opacity_has_colours_and_a_matte(kind: str, tmp_path: Path) -> None:
    path, multiplied = written(tmp_path, kind), kind == "premultiplied"
    matte, colours = read(path, "matte"), read(path, "straight", multiplied)
    discs = np.stack([disc(index) for index in range(COUNT)])
    assert np.abs(matte[..., 0].astype(int) - discs[..., 3]).max() <= (2 if kind == "vp9" else 1)
    lossy = kind in ("vp9", "prores")
    seen = discs[..., 3] > 32
    assert np.abs(colours.astype(int) - discs[..., :3])[seen].mean() < (8 if lossy else 3)
    if not lossy:  # where nothing is seen, the colours go on: no black and no white comes near the edge
        assert np.abs(colours.astype(int) - (209, 76, 68)).max() <= (16 if multiplied else 3)
    white = read(path, "white", multiplied)
    assert (white[:, 2, 2] >= 254).all() and np.abs(white[0, 48, 55].astype(int) - (209, 76, 68)).max() <= 8


@pytest.mark.parametrize("background", [(255, 0, 0), (0, 255, 0), (0, 0, 0)])
def test_a_premultiplied_sequence_has_no_fringe(background: tuple[int, int, int], tmp_path: Path) -> None:
    path = written(tmp_path, "premultiplied")
    colours, matte = read(path, "straight", multiplied=True).astype(float), read(path, "matte") / 255
    wanted = np.stack([disc(i) for i in range(COUNT)]).astype(float)
    clear = wanted[..., 3:] / 255
    over = colours * matte + np.array(background) * (1 - matte)
    assert np.abs(over - (wanted[..., :3] * clear + np.array(background) * (1 - clear))).max() <= 2
    fringe = read(path, "straight").astype(float) * matte + np.array(background) * (1 - matte)
    assert np.abs(fringe - over).max() > 20  # without the switch


def test_opacity_that_is_not_used_is_named(tmp_path: Path) -> None:
    path = written(tmp_path, "prores")
    assert probe(path).alpha and not probe(path).notes  # the job knows whether the film has opacity
    with VideoReader(path) as plain:
        assert any("over white" in note.message for note in plain.notes)
    with GuardedReader(path, options=SourceOptions(opacity="matte")) as reader:
        assert reader.has_alpha and not any("over white" in note.message for note in reader.notes)
        assert (next(reader.read())[2, 2] == 0).all()


def test_colours_of_what_is_seen_are_kept_exactly() -> None:
    rgba = np.random.default_rng(3).integers(0, 256, (61, 47, 4), dtype=np.uint8)
    rgba[10:30, 5:40, 3] = 0
    seen = rgba[..., 3] > 0
    np.testing.assert_array_equal(extended(rgba)[seen], rgba[..., :3][seen])
    np.testing.assert_array_equal(extended(np.dstack([rgba[..., :3], np.zeros((61, 47), np.uint8)])), rgba[..., :3])
    flat = np.full((9, 9, 4), (40, 80, 120, 128), np.uint8)
    assert np.abs(unpremultiplied(premultiplied(flat)).astype(int) - flat).max() <= 1
