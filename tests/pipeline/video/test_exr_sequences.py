"""EXR files as images, sequences and shots, read by the decoder process, which may not write any file."""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest

from pipeline.video.guard.reader import GuardedReader
from pipeline.video.probe import probe_guarded

SIZE = (96, 64)
Writer = Callable[[Path, float], None]


def _write(path: Path, value: float, dtype: Any = np.float16, compression: Any = OpenEXR.ZIP_COMPRESSION) -> None:
    planes = {channel: np.full(SIZE[::-1], value, dtype) for channel in "RGB"}
    with OpenEXR.File({"compression": compression, "type": OpenEXR.scanlineimage}, planes) as file:
        file.write(str(path))


def half(path: Path, value: float) -> None:
    _write(path, value)


def full(path: Path, value: float) -> None:
    _write(path, value, np.float32)


def lossy(path: Path, value: float) -> None:
    _write(path, value, compression=OpenEXR.DWAA_COMPRESSION)


def several_parts(path: Path, value: float) -> None:
    kinds = (("beauty", "RGB", value), ("depth", "Z", 9.0))
    parts = [
        OpenEXR.Part(
            {"type": OpenEXR.scanlineimage}, {c: np.full(SIZE[::-1], level, np.float16) for c in channels}, name
        )
        for name, channels, level in kinds
    ]
    with OpenEXR.File(parts) as file:
        file.write(str(path))


def overscan(path: Path, value: float) -> None:
    """The data window reaches 8 px beyond the display window on every side."""
    header = {
        "compression": OpenEXR.ZIP_COMPRESSION,
        "type": OpenEXR.scanlineimage,
        "displayWindow": (np.array([0, 0], np.int32), np.array([95, 63], np.int32)),
        "dataWindow": (np.array([-8, -8], np.int32), np.array([103, 71], np.int32)),
    }
    planes = {channel: np.full((80, 112), value, np.float16) for channel in "RGB"}
    with OpenEXR.File(header, planes) as file:
        file.write(str(path))


every_kind = pytest.mark.parametrize("write", [half, full, lossy, several_parts, overscan])


def _zipped(folder: Path, out: Path) -> Path:
    with zipfile.ZipFile(out, "w") as archive:
        for path in sorted(folder.rglob("*.exr")):
            archive.write(path, path.relative_to(folder))
    return out


def _means(path: Path) -> list[float]:
    with GuardedReader(path) as reader:
        frames = list(reader.read(0, reader.frames))
    assert all(frame.shape == (64, 96, 3) for frame in frames)
    return [float(frame.mean()) for frame in frames]


@every_kind
def test_one_image(tmp_path: Path, write: Writer) -> None:
    write(tmp_path / "a.exr", 0.5)
    info = probe_guarded(tmp_path / "a.exr")
    assert (info.kind, info.width, info.height, info.frames) == ("image", *SIZE, 1)
    assert _means(tmp_path / "a.exr") == pytest.approx([188], abs=1.5)  # 0.5 linear is 188 in sRGB


@every_kind
def test_a_zip_of_images_of_different_length(tmp_path: Path, write: Writer) -> None:
    folder = tmp_path / "frames"
    folder.mkdir()
    write(folder / "f_1.exr", 1.0)
    noise = np.random.default_rng(0).random((64, 96)).astype(np.float32)
    with OpenEXR.File({"type": OpenEXR.scanlineimage}, dict.fromkeys("RGB", noise)) as file:
        file.write(str(folder / "f_2.exr"))  # longer than its neighbours in bytes
    write(folder / "f_03.exr", 0.0)
    path = _zipped(folder, tmp_path / "a.zip")
    info = probe_guarded(path)
    assert (info.kind, info.width, info.height, info.frames) == ("archive", *SIZE, 3)
    first, _, last = _means(path)
    assert (first, last) == pytest.approx((255, 0), abs=1.5)


def test_a_shot(tmp_path: Path) -> None:
    for folder in ("frames", "normals"):
        (tmp_path / "shot" / folder).mkdir(parents=True)
        for number in (1, 2):
            half(tmp_path / "shot" / folder / f"{number}.exr", 0.5)
    path = _zipped(tmp_path / "shot", tmp_path / "a.zip")
    info = probe_guarded(path)
    assert (info.kind, info.width, info.height, info.frames) == ("archive", *SIZE, 2)
    assert _means(path) == pytest.approx([188, 188], abs=1.5)


def test_a_folder(tmp_path: Path) -> None:
    for number in (1, 2):
        half(tmp_path / f"{number}.exr", 0.5)
    assert _means(tmp_path) == pytest.approx([188, 188], abs=1.5)
