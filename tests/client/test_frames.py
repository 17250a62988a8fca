"""Arrays become pictures of the same values, in the depth that they have."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from impasto_client import BadFrame
from impasto_client.frames import read_frames, write_frames
from pipeline.video.reader import VideoReader

RAMP = np.arange(32 * 48 * 3, dtype=np.uint16).reshape(32, 48, 3)


def test_a_zip_of_arrays_is_a_video_with_its_rate_and_numbers(tmp_path: Path) -> None:
    images = [(RAMP + shift).astype(np.uint8) for shift in (0, 70, 140)]
    assert write_frames(tmp_path / "a.zip", images, fps=12.5, first=1001) == 3
    with VideoReader(tmp_path / "a.zip") as reader:
        assert (reader.fps, reader.index.numbers) == (12.5, (1001, 1002, 1003))
        assert np.array_equal(np.stack(list(reader.read())), np.stack(images))
    assert all(np.array_equal(*pair) for pair in zip(read_frames(tmp_path / "a.zip"), images, strict=True))


@pytest.mark.parametrize("image", [RAMP * 14, (RAMP * 14 / 65535).astype(np.float32), (RAMP * 14 / 65535)])
def test_sixteen_bits_and_floats_keep_sixteen_bits(image: Any, tmp_path: Path) -> None:
    write_frames(tmp_path / "a.zip", [image])
    data = zipfile.ZipFile(tmp_path / "a.zip").read("0000000.png")
    found = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)[..., ::-1]
    assert found.dtype == np.uint16 and np.array_equal(found, RAMP * 14)


def test_gray_and_opacity_are_kept(tmp_path: Path) -> None:
    gray, rgba = RAMP[..., 0].astype(np.uint8), np.dstack([RAMP, RAMP[..., :1]]).astype(np.uint8)
    for image in (gray, rgba):
        write_frames(tmp_path / "a.zip", [image])
        assert np.array_equal(next(read_frames(tmp_path / "a.zip")), image)


@pytest.mark.parametrize("wrong", [np.zeros((4, 4, 2), np.uint8), np.zeros((4, 4, 3), np.int64), np.zeros(4)])
def test_what_is_no_picture_is_refused(wrong: Any, tmp_path: Path) -> None:
    with pytest.raises(BadFrame, match=r"frames\[0\]"):
        write_frames(tmp_path / "a.zip", [wrong])
