"""Short clips from procedural scenes, and inputs for them."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Frame
from pipeline.scenes import scene
from pipeline.scenes.shot import shot_files

SIZE = (96, 64)
FRAMES = 8
LAYERS = {"back": ("wall", "disc", "bar"), "front": ("square", "star", "triangle", "ring")}
DESIGN: dict[str, Any] = {
    "version": 1,
    "regions": {"left": {"label": 1, "border": "soft"}, "sky": {"objects": [1]}},
    "keys": [
        {"region": "left", "frame": 0, "style": "pointillism", "ease": "smooth"},
        {"region": "left", "frame": 5, "set": {"hue": 80}},
    ],
    "directions": [
        {"region": "left", "frame": 0, "edge_weight": 0.1, "elements": [{"pattern": "node", "at": [0.2, 0.5]}]},
        {"region": "sky", "free": True},
    ],
}
"""Region `left` is given by label maps, region `sky` by the largest object that the method finds."""


@cache
def cut() -> tuple[Frame, ...]:
    """A pan over a bay, then, after frame 3, a hard cut to a face."""
    made = scene("cut", SIZE, frames=FRAMES, fps=8)
    return tuple(made.image(index) for index in range(FRAMES))


@cache
def shapes() -> tuple[Frame, ...]:
    """Textured shapes that rotate and occlude each other."""
    made = scene("shapes", SIZE, frames=FRAMES, fps=12)
    return tuple(made.image(index) for index in range(FRAMES))


@cache
def long_shapes() -> tuple[Frame, ...]:
    """The same for 14 frames: more than one run of the method patches."""
    made = scene("shapes", SIZE, frames=14, fps=12)
    return tuple(made.image(index) for index in range(14))


@cache
def haze() -> tuple[Frame, ...]:
    """The textured shapes in haze."""
    return tuple(np.rint(150 + 0.3 * (frame - 150.0)).astype(np.uint8) for frame in shapes())


CLIPS = {"cut": cut, "shapes": shapes, "long-shapes": long_shapes, "haze": haze}


@cache
def painting() -> Frame:
    """An image of few flat colours that serves as a painting: (80, 120, 3)."""
    made = scene("portrait", (120, 80), frames=1, seed=3).image(0)
    return np.ascontiguousarray(made // 32 * 32 + 16)


def posterized(video: tuple[Frame, ...]) -> tuple[Frame, ...]:
    """The video with few tones that change from frame to frame, as if a tool had stylised each frame alone."""
    return tuple(
        (frame // step * step + step // 2).astype(np.uint8) for frame, step in zip(video, range(32, 64), strict=False)
    )


def plain() -> Frame:
    """The unpainted counterpart of `painting`."""
    return scene("portrait", (120, 80), frames=1, seed=3).image(0)


def line_art() -> tuple[Frame, ...]:
    """Black outlines on white, one frame for each of `shapes`."""
    made = scene("shapes", SIZE, frames=FRAMES, fps=12)
    return tuple(_gray(255 - 255 * made.frame(index).lines) for index in range(FRAMES))


def painting_lines() -> Frame:
    """Black lines on white, of the painting's size."""
    return _gray(255 - 255 * scene("portrait", (120, 80), frames=1, seed=3).frame(0).lines)


def object_maps() -> tuple[Frame, ...]:
    """Objects of `shapes` as clearly different gray levels."""
    made = scene("shapes", SIZE, frames=FRAMES, fps=12)
    return tuple(_gray(32.0 * made.frame(index).ids) for index in range(FRAMES))


def painting_objects() -> Frame:
    """The same for the painting."""
    return _gray(32.0 * scene("portrait", (120, 80), frames=1, seed=3).frame(0).ids)


def _gray(values: NDArray[Any]) -> Frame:
    return np.ascontiguousarray(np.repeat(np.rint(values).astype(np.uint8)[..., None], 3, axis=2))


def keyframe(index: int) -> Frame:
    """Frame `index` of `shapes`, painted over: channels exchanged and coarse."""
    return np.ascontiguousarray(np.roll(shapes()[index], 1, axis=-1) // 16 * 16)


def partial_keyframe(index: int) -> NDArray[np.uint8]:
    """RGBA: `keyframe(index)`, painted in its middle only."""
    alpha = np.zeros((SIZE[1], SIZE[0], 1), np.uint8)
    alpha[16:52, 20:80] = 255
    return np.dstack([keyframe(index), alpha])


def middle_mask() -> NDArray[np.uint8]:
    """White in the middle, black elsewhere, (height, width)."""
    mask = np.zeros((SIZE[1], SIZE[0]), np.uint8)
    mask[16:52, 20:80] = 255
    return mask


def left_labels(columns: int) -> NDArray[np.uint8]:
    """A label map: label 1 in the leftmost columns, 0 elsewhere."""
    labels = np.zeros((SIZE[1], SIZE[0]), np.uint8)
    labels[:, :columns] = 1
    return labels


@cache
def object_labels(index: int) -> NDArray[np.uint16]:
    """A corrected label map of `shapes`: 1 = background, then one label per object."""
    made = scene("shapes", SIZE, frames=FRAMES, fps=12)
    ids: NDArray[np.uint16] = made.frame(index).ids.astype(np.uint16)
    return ids


@cache
def shot() -> Mapping[str, bytes]:
    """The files of a rendered shot of `shapes`: frames, passes, two layers without a style."""
    return dict(shot_files(scene("shapes", SIZE, frames=FRAMES, fps=12), LAYERS))


def png(image: NDArray[np.uint8]) -> bytes:
    """An RGB or RGBA picture as PNG."""
    code = cv2.COLOR_RGBA2BGRA if image.shape[2] == 4 else cv2.COLOR_RGB2BGR
    return cv2.imencode(".png", cv2.cvtColor(image, code))[1].tobytes()


def styled_shot() -> dict[str, bytes]:
    """The shot with a style for each layer, one of them with its plain picture."""
    return {
        **shot(), "layers/back/style/output.png": png(painting()), "layers/back/style/input.png": png(plain()),
        "layers/front/style/output.png": png(np.ascontiguousarray(painting()[::-1])),
    }  # fmt: skip


def keyed_shot() -> dict[str, bytes]:
    """The shot with a painted keyframe of its front layer."""
    front = np.where(object_labels(0) > 3, 255, 0).astype(np.uint8)
    key = np.dstack([keyframe(0), front])
    return {**shot(), "layers/back/style/output.png": png(painting()), "layers/front/keyframes/0000.png": png(key)}


def unlayered_shot() -> dict[str, bytes]:
    """The shot with exact vectors and without layers."""
    files = {name: data for name, data in shot().items() if name != "shot.json"}
    return {**files, "style/output.png": png(painting())}
