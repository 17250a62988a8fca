"""EXR files: channel types, passes by name, and signs of velocities."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest

from pipeline.errors import MediaTooLarge, UnreadableMedia
from pipeline.formats.base import PlaneImage
from pipeline.formats.exr import EXR
from pipeline.passes.find import depth, normals, object_ids
from pipeline.video.media import Limits
from pipeline.video.passes import picture


def read_exr(source: bytes | Path, limits: Limits = Limits(), name: str = "image") -> PlaneImage:
    return EXR.planes(source, limits, name)


def write(path: Path, channels: dict[str, np.ndarray], header: dict[str, Any] | None = None) -> Path:
    made = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage} | (header or {})
    with OpenEXR.File(made, channels) as file:
        file.write(str(path))
    return path


@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.uint32])
def test_half_float_and_integer_channels(tmp_path: Path, dtype: Any) -> None:
    plane = np.arange(12, dtype=dtype).reshape(3, 4)
    image = read_exr(write(tmp_path / "a.exr", {"IndexOB.X": plane}))
    assert image.size == (4, 3) and image.planes["IndexOB.X"].dtype == np.float32
    np.testing.assert_array_equal(image.planes["IndexOB.X"], plane.astype(np.float32))


def test_several_parts(tmp_path: Path) -> None:
    parts = [
        OpenEXR.Part({"type": OpenEXR.scanlineimage}, {n: np.full((4, 5), k, np.float16)}, part)
        for k, (part, n) in enumerate((("beauty", "Combined.R"), ("motion", "Vector.X")))
    ]
    with OpenEXR.File(parts) as file:
        file.write(str(tmp_path / "a.exr"))
    image = read_exr((tmp_path / "a.exr").read_bytes())
    assert {name: plane[0, 0] for name, plane in image.planes.items()} == {"beauty.Combined.R": 0, "motion.Vector.X": 1}


def test_a_data_window_smaller_than_the_picture(tmp_path: Path) -> None:
    window = (np.array([2, 1], np.int32), np.array([3, 2], np.int32))
    display = (np.array([0, 0], np.int32), np.array([5, 3], np.int32))
    path = write(
        tmp_path / "a.exr", {"Z": np.ones((2, 2), np.float32)}, {"dataWindow": window, "displayWindow": display}
    )
    image = read_exr(path)
    assert image.size == (6, 4) and image.planes["Z"].sum() == 4
    assert (image.planes["Z"][1:3, 2:4] == 1).all()


def test_invalid_truncated_and_too_large_files_are_rejected(tmp_path: Path) -> None:
    path = write(tmp_path / "a.exr", {"Z": np.ones((40, 50), np.float32)})
    whole = path.read_bytes()
    for wrong in (b"", b"\x76\x2f\x31\x01 and no more", whole[:200], whole[:-1]):
        with pytest.raises(UnreadableMedia):
            read_exr(wrong, name="frame 7")
    with pytest.raises(MediaTooLarge):
        read_exr(path, Limits(side_px=20))


def test_passes_are_found_by_their_names() -> None:
    plane = np.full((2, 3), 0.5, np.float32)
    names = ["Combined.R", "Combined.G", "Combined.B", "Normal.X", "Normal.Y", "Normal.Z", "Depth.Z", "IndexOB.X"]
    image = PlaneImage((3, 2), {f"ViewLayer.{name}": plane for name in names})
    frame = picture(image)
    assert frame is not None and (frame == 188).all()
    found = normals(image)
    assert found is not None and found.shape == (2, 3, 3)
    assert depth(image) is not None and object_ids(image) is not None


def test_deep_pixels_are_refused_with_the_remedy(tmp_path: Path) -> None:
    with pytest.raises(UnreadableMedia) as raised:
        EXR.planes(write_deep(tmp_path / "d.exr"), Limits(), "d.exr")
    assert "deep" in raised.value.message and "Flatten" in str(raised.value.remedy)


def write_deep(path: Path) -> Path:
    samples = np.empty((32, 32), dtype=object)
    for at in np.ndindex(32, 32):
        samples[at] = np.array([0.5, 0.2][: 1 + sum(at) % 2], np.float32)
    channels = {name: OpenEXR.Channel(name, samples) for name in "RGBAZ"}
    header = {"type": OpenEXR.deepscanline, "compression": OpenEXR.ZIPS_COMPRESSION}
    with OpenEXR.File(header, channels) as file:
        file.write(str(path))
    return path
