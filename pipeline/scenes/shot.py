"""Export of a scene as the files of a rendered shot (`pipeline.video.shot_archive`), with exact passes."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Arrays
from pipeline.errors import BadParameter
from pipeline.formats.exr import write_exr
from pipeline.scenes.base import Scene, SceneFrame
from pipeline.video.archive import MANIFEST
from pipeline.video.stills import encode_gray_png, encode_png

Layers = Mapping[str, tuple[str, ...]]
"""Layer name -> names of its objects, from back to front."""


def shot_files(scene: Scene, layers: Layers | None = None) -> Iterator[tuple[str, bytes]]:
    """Path and contents of each file: frames, vectors (as Cycles writes them), normals, ids, lines, shot.json.

    Args:
        layers: None = one layer for each object of the scene.

    Raises:
        BadParameter: a layer names an object that is not in the scene.
    """
    numbers = {thing: number for number, thing in scene.things.items()}
    chosen = layers or {thing: (thing,) for thing in numbers}
    for thing in (thing for things in chosen.values() for thing in things):
        if thing not in numbers:
            raise BadParameter("Object not found in the scene.", field="layers", value=thing,
                               remedy=f"It has: {', '.join(numbers)}.")  # fmt: skip
    listed = [{"name": name, "ids": [numbers[thing] for thing in things]} for name, things in chosen.items()]
    manifest = {"version": 1, "vectors": "cycles", "layers": listed}
    yield MANIFEST, (json.dumps(manifest, indent=1) + "\n").encode()
    for index in range(scene.frames):
        yield from _passes(scene.frame(index), f"{index:04d}")


def _passes(frame: SceneFrame, number: str) -> Iterator[tuple[str, bytes]]:
    yield f"frames/{number}.png", encode_png(frame.image)
    yield f"ids/{number}.png", encode_gray_png(frame.ids.astype(np.uint8))
    yield f"lines/{number}.png", encode_gray_png(np.rint(255 - frame.lines * 255).astype(np.uint8))
    normals = np.rint((frame.normals + 1) * 127.5).astype(np.uint8)
    yield f"normals/{number}.png", encode_png(normals)
    yield f"vectors/{number}.exr", _exr(vectors(frame))


def vectors(frame: SceneFrame) -> dict[str, NDArray[np.float32]]:
    """Vector pass in the convention of Blender's Cycles: XY = previous - current, ZW = current - next, px, y up."""
    minus, plus = frame.velocity_previous, frame.velocity_next
    return {"Vector.X": -minus[..., 0], "Vector.Y": minus[..., 1], "Vector.Z": -plus[..., 0], "Vector.W": plus[..., 1]}


def _exr(planes: Arrays) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "pass.exr"
        write_exr(path, planes)
        return path.read_bytes()
