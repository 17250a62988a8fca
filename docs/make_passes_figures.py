"""Draws the figures of docs/method-passes.md from the passes themselves.

python -m docs.make_passes_figures [MEDIA]
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from docs.pictures import CLIPS, DOCS, MEDIA, frames, grid, save
from pipeline.arrays import AnyArray, State
from pipeline.frames import Frame
from pipeline.methods import method
from pipeline.methods.base import MadePass
from pipeline.methods.local import LocalContext, required_inputs, run_plan
from pipeline.perception.cuts import is_cut, thumbnail

FOLDER = DOCS / "method-passes"
HEIGHT = 270
SHOWN = 11
"""Frame of the clip whose passes are shown."""
UNLABELLED = (215, 30, 30)


def made(name: str, video: Sequence[Frame], params: Mapping[str, Any]) -> dict[int, State]:
    """All passes of a method, by frame and name."""
    chosen = method(name)
    context = LocalContext(chosen.Params(**params), list(video), required_inputs(chosen, list(video)))
    context.passes_wanted = frozenset(one.name for one in chosen.makes_passes)
    run_plan(chosen, context)
    return context.made_passes


def shown(one: MadePass, array: AnyArray, size: tuple[int, int]) -> Frame:
    """A pass as a picture: numbers in random colours, vectors as hue and saturation, the rest as light."""
    if one.ids:
        hashed = np.asarray(array, np.uint64) * np.uint64(0x9E3779B97F4A7C15) >> np.uint64(40)
        made = np.stack([hashed >> np.uint64(shift) & np.uint64(255) for shift in (0, 8, 16)], -1).astype(np.uint8)
        made[np.asarray(array) == 0] = UNLABELLED
        return np.asarray(cv2.resize(made, size, interpolation=cv2.INTER_NEAREST), np.uint8)
    values = np.asarray(cv2.resize(np.asarray(array, np.float32), size, interpolation=cv2.INTER_LINEAR))
    if one.channels == ("X", "Y"):
        return directions(values)
    light = values if values.ndim == 3 else np.dstack([values] * 3)
    top = max(1.0, float(np.percentile(light, 99)))
    return np.asarray(np.clip(light[..., :3] / top * 255, 0, 255), np.uint8)


def directions(values: AnyArray) -> Frame:
    """Vectors: the hue says where to, the saturation how far."""
    far = np.hypot(values[..., 0], values[..., 1])
    hue = np.arctan2(values[..., 1], values[..., 0]) % (2 * np.pi) / (2 * np.pi) * 179
    saturation = np.clip(far / max(float(np.percentile(far, 99)), 1e-6), 0, 1) * 255
    hsv = np.dstack([hue, saturation, np.full_like(far, 255)]).astype(np.uint8)
    return np.asarray(cv2.cvtColor(hsv, cv2.COLOR_HSV2RGB), np.uint8)


def draw_methods(media: Path) -> None:
    """One sheet for each method."""
    video = list(frames(CLIPS["coffee"], media, 0, SHOWN + 2, HEIGHT))
    size = video[0].shape[1::-1]
    for name in ("abstraction", "multistyle", "patches", "analogy", "steady"):
        found = made(name, video, {})[SHOWN]
        passes = [one for one in method(name).makes_passes if found[one.name].any()]
        tiles = [video[SHOWN], *(shown(one, found[one.name], size) for one in passes)]
        print(save(grid(tiles, 3, ["source", *(one.name for one in passes)]), FOLDER / f"{name}.jpg"))


def cut_of(video: Sequence[Frame]) -> int:
    """The first frame of the second shot."""
    thumbnails = [thumbnail(frame) for frame in video]
    return next(index for index, (a, b) in enumerate(pairwise(thumbnails), 1) if is_cut(a, b, 1.0))


def draw_propagation(media: Path) -> None:
    """Figures 3 and 8 of zhang2011online: a slow scene, and a change of scene without the detector of cuts."""
    bunny = list(frames(CLIPS["bunny"], media, 0, 330, HEIGHT))
    cut = cut_of(bunny)
    examples = {
        "slow": (list(frames(CLIPS["coffee"], media, 0, 10, HEIGHT)), 9),
        "cut": (bunny[cut - 8 : cut + 2], 8),
    }
    tiles: list[Frame] = []
    labels, propagated = (one for one in method("abstraction").makes_passes if one.name in ("labels", "propagated"))
    for video, at in examples.values():
        found, size = made("abstraction", video, {"cut_sensitivity": 0}), video[0].shape[1::-1]
        residual = np.asarray(cv2.resize(found[at]["residual"], size, interpolation=cv2.INTER_NEAREST)) > 0
        gray = cv2.cvtColor(cv2.cvtColor(video[at], cv2.COLOR_RGB2GRAY), cv2.COLOR_GRAY2RGB) // 2 + 110
        tiles += [
            video[at - 1], video[at], np.where(residual[..., None], UNLABELLED, gray).astype(np.uint8),
            shown(propagated, found[at]["propagated"], size), shown(labels, found[at - 1]["labels"], size),
            shown(labels, found[at]["labels"], size),
        ]  # fmt: skip
        print(f"left unlabelled: {residual.mean():.1%}")
    names = ["previous frame", "frame", "residual", "propagated", "labels before", "labels"]
    print(save(grid(tiles, 3, names * 2), FOLDER / "propagation.jpg"))


if __name__ == "__main__":
    place = Path(sys.argv[1]) if len(sys.argv) > 1 else MEDIA
    draw_propagation(place)
    draw_methods(place)
