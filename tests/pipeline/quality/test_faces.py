"""Faces are detected in the source and searched for in the painting."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from pipeline.quality.faces import FaceCounter
from pipeline.video.reader import VideoReader


def test_no_face_is_no_loss() -> None:
    noise = np.random.default_rng(0).integers(0, 256, (96, 96, 3), np.uint8)
    assert FaceCounter().count(noise, noise) == (0, 0)


@pytest.mark.real("media")
def test_a_face_is_kept_by_a_light_blur_and_lost_by_a_strong_one(media: Path) -> None:
    with VideoReader(media / "video" / "face_portrait_768x1024.mp4") as reader:
        frame = cv2.resize(next(reader.read()), (384, 512), interpolation=cv2.INTER_AREA)
    counter = FaceCounter()
    assert counter.count(frame, cv2.GaussianBlur(frame, (0, 0), 1)) == (1, 1)
    assert counter.count(frame, cv2.GaussianBlur(frame, (0, 0), 40)) == (1, 0)


@pytest.mark.real("media")
def test_a_wide_frame_is_searched_at_640_px(media: Path) -> None:
    with VideoReader(media / "video" / "face_portrait_768x1024.mp4") as reader:
        frame = next(reader.read())
    wide = cv2.copyMakeBorder(frame, 0, 0, 256, 256, cv2.BORDER_REPLICATE)
    small = cv2.resize(wide, (640, 512), interpolation=cv2.INTER_AREA)
    counter = FaceCounter()
    assert counter.count(wide, wide) == counter.count(small, small) == (1, 1)
