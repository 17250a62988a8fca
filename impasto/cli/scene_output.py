"""A procedural scene on disk: as a video, or as a folder with every pass of every frame.

image/0000.png              8-bit RGB
ids/0000.png                16-bit: object of each pixel, see "things"
lines/0000.png              8-bit: coverage by outlines
occluded_next/0000.png      8-bit: 255 where the point is hidden or outside in the next frame
occluded_previous/0000.png  the same for the frame before
velocity_next/0000.npy      float32 (height, width, 2), px: a point at p is at p + v in the next frame
velocity_previous/0000.npy  a point at p was at p - v in the frame before
normals/0000.npy            float32 (height, width, 3): x right, y down, z towards us
orientation/0000.npy        float32 (height, width): radians in [0, pi)
scene.json                  size, frames, fps, things
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterable, Iterator
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np
from rich.progress import track

from impasto.cli.console import err
from impasto.delivery import check_new, deliver, forget, swap, target
from pipeline.arrays import AnyArray
from pipeline.errors import BadInput
from pipeline.scenes import Scene, SceneFrame
from pipeline.video.join import join
from pipeline.video.writer import SegmentSpec, segment_writer
from workers.contract.request import Json

MANIFEST = "scene.json"
QUALITY = 12
"""Rate factor of scene videos, low enough that paintings of them do not show compression artefacts."""


def draw(scene: Scene, output: str, overwrite: bool, quiet: bool) -> Path:
    """Write the scene to `output` and return its path; a folder with a scene is replaced.

    Raises: BadInput about `--output`, OSError.
    """
    path = Path(output).expanduser().absolute()
    if output.endswith(("/", "\\")) or path.is_dir():
        _draw_passes(scene, path, quiet)
    else:
        check_new(path, overwrite)
        _draw_video(scene, output, quiet)
    return path


def _draw_video(scene: Scene, output: str, quiet: bool) -> None:
    where = target(output)
    rate = Fraction(scene.fps).limit_denominator(1001)
    spec = SegmentSpec(where.format, scene.size, 1 / rate, scene.fps, QUALITY)
    with tempfile.TemporaryDirectory(prefix="impasto-") as scratch:
        segment, whole = Path(scratch) / "segment", Path(scratch) / "whole"
        with segment_writer(segment, spec) as writer:
            for index in _shown(range(scene.frames), scene, quiet):
                writer.write(index, scene.image(index), index, index + 1)
        join([(Fraction(0), segment)], whole, spec.format)
        deliver(whole, where)


def _draw_passes(scene: Scene, folder: Path, quiet: bool) -> None:
    if folder.is_dir() and any(folder.iterdir()) and not (folder / MANIFEST).is_file():
        raise BadInput(
            "The folder contains something else than a scene.",
            field="--output",
            value=folder,
            remedy="Name a new folder.",
        )
    folder.parent.mkdir(parents=True, exist_ok=True)
    part = folder.with_name(f".{folder.name}.part")
    forget(part)
    try:
        for index in _shown(range(scene.frames), scene, quiet):
            for name, data in _passes(scene.frame(index)):
                _save(part / name, index, data)
        (part / MANIFEST).write_text(json.dumps(_manifest(scene), indent=2) + "\n")
        swap(part, folder)
    finally:
        forget(part)


def _passes(frame: SceneFrame) -> Iterator[tuple[str, AnyArray]]:
    """Pass name -> array to save; integers become PNG, floats npy."""
    yield "image", frame.image[..., ::-1]
    yield "ids", frame.ids.astype(np.uint16)
    yield "lines", np.rint(frame.lines * 255).astype(np.uint8)
    yield "occluded_next", frame.occluded_next.astype(np.uint8) * np.uint8(255)
    yield "occluded_previous", frame.occluded_previous.astype(np.uint8) * np.uint8(255)
    yield "velocity_next", frame.velocity_next
    yield "velocity_previous", frame.velocity_previous
    yield "normals", frame.normals
    yield "orientation", frame.orientation


def _save(folder: Path, index: int, data: AnyArray) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    if np.issubdtype(data.dtype, np.floating):
        np.save(folder / f"{index:04d}.npy", data)
        return
    _, png = cv2.imencode(".png", np.ascontiguousarray(data))
    (folder / f"{index:04d}.png").write_bytes(png.tobytes())


def _manifest(scene: Scene) -> Json:
    width, height = scene.size
    things = {str(number): name for number, name in scene.things.items()}
    return {
        "name": scene.name,
        "width": width,
        "height": height,
        "frames": scene.frames,
        "fps": scene.fps,
        "things": things,
    }


def _shown(frames: Iterable[int], scene: Scene, quiet: bool) -> Iterable[int]:
    """The frame numbers, with a bar on a terminal."""
    return frames if quiet or not err.is_terminal else track(frames, scene.name, console=err, transient=True)
