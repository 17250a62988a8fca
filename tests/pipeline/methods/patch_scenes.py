"""Scenes with ground truth for painting patches: a pan, moving objects, and one that is hidden for three frames."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Frame, Labels
from pipeline.methods import parse_params
from pipeline.methods.local import LocalContext, iterate_plan, run_plan
from pipeline.methods.patches import Patches
from pipeline.scenes import paints as p
from pipeline.scenes.base import CutOut, SceneFrame
from pipeline.scenes.outlines import box, disc, everywhere
from pipeline.scenes.pose import Pose
from pipeline.scenes.stage import Stage

SIZE = (240, 144)
FPS = 24.0
HIDDEN = range(6, 9)
"""Frames in which the blob is hidden."""
PAN_PX = 2
"""Motion of the background, px a frame, to the left."""


def px(value: float) -> float:
    """Pixels in the units of the scene, frame heights."""
    return value / SIZE[1]


def stage(frames: int = 14) -> Stage:
    """A wall that pans by whole pixels, a disc and a slab that move, too, and a blob that is hidden for a while."""
    wall = p.grainy(p.vertical("#7f8f6a", "#3f545f", 0.0, 1.0), 0.45, 0.25, 1)
    parts = [
        CutOut("wall", everywhere, wall, lambda t: Pose.shift(px(-PAN_PX * t * FPS), 0), line_px=0),
        _object("disc", disc(0, 0, px(22)), "#d95f4b", 2, lambda n: (-60 + 1.5 * n, 40 + 1.0 * n), 24),
        _object("slab", box(0, 0, px(26), px(18), px(3)), "#4f7cac", 3, lambda n: (40 - 4.0 * n, 106), 28),
        _object("blob", disc(0, 0, px(17)), "#e0a458", 4, lambda n: (58 + 1.0 * n, 40 - 0.5 * n), 20, HIDDEN),
    ]
    return Stage("patches", parts, SIZE, frames, FPS)


def _object(name: str, outline: Any, code: str, seed: int, at: Any, half: float, hidden: range = range(0)) -> CutOut:
    """A part at position `at(frame)`, px from the middle of the top edge; absent in the `hidden` frames."""

    def motion(t: float) -> Pose:
        number = t * FPS
        x, y = at(number)
        return Pose.shift(px(x), px(y)) @ Pose.scale(0.0 if round(number) in hidden else 1.0)

    paint = p.grainy(p.flat(code), 0.4, 0.12, seed)
    return CutOut(name, outline, paint, motion, (-px(half), -px(half), px(half), px(half)), line_px=0)


@cache
def truth(frames: int = 14) -> tuple[SceneFrame, ...]:
    return tuple(stage(frames))


def paint(
    frames: list[Frame], inputs: Mapping[str, Any] | None = None, artefacts: frozenset[str] = frozenset(),
    **params: Any,
) -> LocalContext:  # fmt: skip
    """Run the method's whole plan."""
    context = LocalContext(parse_params(Patches(), params), frames, inputs, artefacts=artefacts)
    run_plan(Patches(), context)
    return context


def clustered(frames: list[Frame], inputs: Mapping[str, Any] | None = None) -> LocalContext:
    """Run the steps up to the final label maps."""
    context = LocalContext(parse_params(Patches(), {}), frames, inputs)
    for _ in iterate_plan(Patches(), context, steps=3):
        pass
    return context


@cache
def painted_scene() -> LocalContext:
    return paint([shot.image for shot in truth()])


def label_maps(context: LocalContext) -> dict[int, Labels]:
    """Final label maps by frame, at the working size."""
    return {
        int(name.removeprefix("labels-")): array.astype(np.int32)
        for (of_step, key), arrays in context.kept.items()
        if of_step in ("cluster", "correct") and key.startswith("run")
        for name, array in arrays.items()
        if name.startswith("labels-")
    }


def rand_index(a: NDArray[Any], b: NDArray[Any]) -> float:
    """Adjusted Rand index of two labellings: 1 = equal partitions, 0 = no better than chance (hubert1985comparing)."""
    _, first = np.unique(a, return_inverse=True)
    _, second = np.unique(b, return_inverse=True)
    table = np.zeros((first.max() + 1, second.max() + 1))
    np.add.at(table, (first.ravel(), second.ravel()), 1)

    def pairs(counts: NDArray[Any]) -> float:
        return float((counts * (counts - 1) / 2).sum())

    both, rows, columns, every = pairs(table), pairs(table.sum(1)), pairs(table.sum(0)), pairs(np.array([a.size]))
    chance = rows * columns / every
    return (both - chance) / ((rows + columns) / 2 - chance)


def swarm(frames: int = 8) -> list[Frame]:
    """Eight textured squares of 12 px, each moving 2 px a frame in a direction of its own, before a textured wall."""

    def grain(seed: int, shape: tuple[int, int], sigma: float) -> NDArray[np.float32]:
        noise = np.random.default_rng(seed).normal(size=shape).astype(np.float32)
        return np.asarray(cv2.GaussianBlur(noise, (0, 0), sigma) * 115, np.float32)

    wall, made = grain(99, SIZE[::-1], 1.5) + 110, list[Frame]()
    for number in range(frames):
        frame = np.repeat(wall[..., None], 3, axis=2)
        for k in range(8):
            x = 30 + 55 * (k % 4) + round(2 * number * np.cos(2.4 * k))
            y = 40 + 60 * (k // 4) + round(2 * number * np.sin(2.4 * k))
            frame[y - 6 : y + 6, x - 6 : x + 6] = (200, 90 + 15 * k, 60) + grain(k, (12, 12), 1.2)[..., None]
        made.append(np.clip(frame, 0, 255).astype(np.uint8))
    return made
