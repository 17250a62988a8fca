"""The step `composite`: layers over each other, from back to front."""

from __future__ import annotations

import numpy as np

from pipeline.frames import Frame
from pipeline.methods.analogy.layers import shot_of
from pipeline.methods.base import Bench, Note, Task
from pipeline.synthesis.images import Bytes

_SYNTHESISE = "synthesise"


def run_composite(task: Task, bench: Bench) -> Note:
    """Frames [start, stop) of every layer, on the background that shot.json names."""
    assert task.emits is not None
    shot = shot_of(bench)
    assert shot is not None
    start, stop = task.emits
    for index in range(start, stop):
        canvas = plain(bench.size, shot.says.background)
        for layer in range(task.args["layers"]):
            painted = bench.load(_SYNTHESISE, paint_name(layer, index))["rgba"]
            with bench.clock("composite"):
                canvas = over(painted, canvas)
        bench.emit(index, canvas)
        bench.progress((index + 1 - start) / (stop - start))
    return {"frames": stop - start}


def paint_name(layer: int, index: int) -> str:
    """Name of the artefact that holds a layer's frame: "rgba", uint8 (h, w, 4), straight opacity."""
    return f"paint-{layer}-{index:07d}"


def plain(size: tuple[int, int], colour: str) -> Frame:
    """A canvas of one colour, "#rrggbb"."""
    return np.full((size[1], size[0], 3), list(bytes.fromhex(colour[1:])), np.uint8)


def over(painted: Bytes, below: Frame) -> Frame:
    """Straight-alpha RGBA over a frame, rounded to nearest: where it is opaque, to the last bit."""
    alpha = painted[..., 3:].astype(np.uint16)
    mixed = painted[..., :3].astype(np.uint16) * alpha + below.astype(np.uint16) * (255 - alpha) + 127
    return np.asarray(mixed // 255, np.uint8)
