"""Shots in memory: scenes with all render passes, for `LocalContext`."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any

import cv2
import numpy as np

from pipeline.frames import Frame
from pipeline.methods import method, parse_params
from pipeline.methods.local import LocalContext
from pipeline.scenes import scene
from pipeline.scenes.shot import shot_files

SIZE = (96, 72)
LAYERS = {"back": ("wall", "disc", "bar"), "front": ("square", "star", "triangle", "ring")}
QUICK = {"levels": 3, "iterations": 3}


def png(image: np.ndarray) -> bytes:
    """Encode an RGB, RGBA or gray image as PNG."""
    code = {3: cv2.COLOR_RGB2BGR, 4: cv2.COLOR_RGBA2BGRA}.get(image.shape[2] if image.ndim == 3 else 0)
    return cv2.imencode(".png", image if code is None else cv2.cvtColor(image, code))[1].tobytes()


@cache
def scene_files(frames: int = 4) -> Mapping[str, bytes]:
    return dict(shot_files(scene("shapes", SIZE, frames=frames, fps=24), LAYERS))


def pictures(frames: int = 4) -> list[Frame]:
    shot = scene("shapes", SIZE, frames=frames, fps=24)
    return [shot.image(index) for index in range(frames)]


def shot_context(files: Mapping[str, bytes], frames: int = 4, **params: Any) -> LocalContext:
    given = {"video.entries": files}
    return LocalContext(parse_params(method("analogy"), QUICK | params), pictures(frames), given)
