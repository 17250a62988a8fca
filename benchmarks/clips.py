"""Frames for benchmarks: a real clip if there is a media folder beside the project, otherwise a procedural scene."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from pipeline.formats.decoding import decode_rgb
from pipeline.frames import Frame
from pipeline.scenes import scene
from pipeline.video.media import Limits
from pipeline.video.reader import VideoReader

MEDIA = Path(__file__).resolve().parents[2] / "shared" / "media" / "video"
CLIPS = {(352, 288): "foreman_cif.mp4", (640, 480): "asl_walk_640x480.mkv", (1280, 720): "dog_720p_audio.mp4"}


def clip(size: tuple[int, int], count: int) -> list[Frame]:
    """`count` frames of `size` (width, height). A clip that is too short is played forwards and backwards."""
    path = MEDIA / CLIPS.get(size, "")
    if path.is_file():
        with VideoReader(path) as reader:
            frames = [fit(frame, size) for frame in reader.read(0, count)]
    else:
        frames = [shot.image for shot in scene("harbour", size=size, frames=min(count, 48))]
    there_and_back = frames + frames[-2:0:-1]
    return [there_and_back[i % len(there_and_back)] for i in range(count)]


def read_picture(path: Path) -> Frame:
    """An image file as RGB, uint8 (height, width, 3)."""
    return decode_rgb(path.read_bytes(), Limits(), path.name)


def fit(frame: Frame, size: tuple[int, int]) -> Frame:
    """The frame scaled to `size` (width, height); unchanged if it already has that size."""
    if (frame.shape[1], frame.shape[0]) == size:
        return frame
    return np.asarray(cv2.resize(frame, size, interpolation=cv2.INTER_AREA), np.uint8)
