"""HDR and wide-gamut sources become sRGB: white stays white, primaries are converted, and the conversion is named."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from pipeline.video.reader import VideoReader
from pipeline.video.wide_colour import HLG, PQ, to_srgb

TO_2020 = np.array([[0.6274, 0.3293, 0.0433], [0.0691, 0.9195, 0.0114], [0.0164, 0.0880, 0.8956]])
"""BT.2087: linear light of BT.709 to that of BT.2020."""


def clip(path: Path, rgb: np.ndarray, primaries: int, transfer: int) -> Path:
    """A lossless film of R'G'B' patches, uint16 (h, w, 3), with these tags."""
    with av.open(str(path), "w") as out:
        stream = out.add_stream("ffv1", rate=25)
        stream.width, stream.height, stream.pix_fmt = rgb.shape[1], rgb.shape[0], "gbrp16le"  # type: ignore[attr-defined]
        context = stream.codec_context
        context.color_primaries, context.color_trc = primaries, transfer  # type: ignore[attr-defined]
        context.colorspace, context.color_range = 0, 2  # type: ignore[attr-defined]
        for index in range(3):
            picture = av.VideoFrame.from_ndarray(rgb, format="rgb48le").reformat(format="gbrp16le")
            picture.pts, picture.time_base = index, Fraction(1, 25)
            out.mux(stream.encode(picture))  # type: ignore[attr-defined]
        out.mux(stream.encode(None))  # type: ignore[attr-defined]
    return path


def shown(path: Path) -> tuple[np.ndarray, str]:
    with VideoReader(path) as reader:
        return next(reader.read())[16, 16].astype(int), " ".join(note.message for note in reader.notes)


def flat(value: object) -> np.ndarray:
    return np.ascontiguousarray(np.broadcast_to(np.rint(np.asarray(value) * 65535), (64, 64, 3)).astype(np.uint16))


@pytest.mark.parametrize(("transfer", "white", "name"), [(PQ, 0.5807, "PQ"), (HLG, 0.75, "HLG")])
def test_diffuse_white_is_white(transfer: int, white: float, name: str, tmp_path: Path) -> None:
    """203 cd/m2 are 58.07 % of PQ's signal and 75 % of HLG's (BT.2408)."""
    seen, notes = shown(clip(tmp_path / "a.mkv", flat([white] * 3), 9, transfer))
    assert (np.abs(seen - 255) <= 3).all() and f"BT.2020 {name}" in notes
    black, _ = shown(clip(tmp_path / "b.mkv", flat([0.0] * 3), 9, transfer))
    assert (black == 0).all()
    brighter, _ = shown(clip(tmp_path / "c.mkv", flat([white + 0.1] * 3), 9, transfer))
    assert (brighter == 255).all()


def test_primaries_of_bt2020_in_sdr_are_converted(tmp_path: Path) -> None:
    rng, errors = np.random.default_rng(5), []
    for number in range(6):
        wanted = rng.integers(20, 256, 3)
        light = ((wanted / 255 + 0.099297) / 1.099297) ** (1 / 0.45)
        wide = TO_2020 @ light
        path = clip(tmp_path / f"{number}.mkv", flat(1.099297 * wide**0.45 - 0.099297), 9, 14)
        seen, notes = shown(path)
        errors.append(np.abs(seen - wanted))
        assert "from BT.2020 to sRGB" in notes
    assert np.mean(errors) < 0.5 and np.max(errors) <= 1


def test_bt709_is_left_alone_and_opacity_is_kept(tmp_path: Path) -> None:
    seen, notes = shown(clip(tmp_path / "a.mkv", flat([0.2, 0.5, 0.7]), 1, 1))
    assert np.abs(seen - np.array([51, 128, 179])).max() <= 1 and "converted" not in notes
    rgba = np.dstack([flat([0.5, 0.5, 0.5]), np.full((64, 64), 32896, np.uint16)])
    assert (to_srgb(rgba, (9, PQ))[..., 3] == 128).all()


AP1 = (0.713, 0.293, 0.165, 0.83, 0.128, 0.044, 0.32168, 0.33767)
"""Chromaticities of ACEScg."""


@pytest.mark.parametrize("tag", [{"chromaticities": AP1}, {"colorInteropID": "lin_ap1_scene"}])
def test_an_exr_of_acescg_is_converted(tag: dict[str, object], tmp_path: Path) -> None:
    """The values of OpenColorIO, ACEScg to sRGB: 255, 24, 44."""
    import OpenEXR

    pixels = np.broadcast_to(np.array((0.8, 0.1, 0.05), np.float16), (64, 64, 3))
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage} | tag
    with OpenEXR.File(header, {"RGB": np.ascontiguousarray(pixels)}) as file:
        file.write(str(tmp_path / "plate.1001.exr"))
    seen, notes = shown(tmp_path / "plate.1001.exr")
    assert np.abs(seen - np.array([255, 24, 44])).max() <= 2 and "converted to Rec. 709" in notes
