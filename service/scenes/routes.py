"""/v1/scenes: a clip of one of Impasto's own scenes, drawn at the first request."""

from __future__ import annotations

import tempfile
from fractions import Fraction
from pathlib import Path as FilePath
from typing import Annotated, Literal

from fastapi import Path

from pipeline.scenes import scene
from pipeline.video.join import join
from pipeline.video.writer import SegmentSpec, segment_writer
from service.assets.adopt import adopt_made
from service.context.depends import Context, Submitter
from service.routing import Router
from workers.contract.record import Asset

router = Router(prefix="/v1/scenes", tags=["assets"])

SIZE = (480, 270)
"""(width, height), px."""
FRAMES, FPS = 30, 12

SceneName = Annotated[Literal["harbour", "portrait", "shapes"], Path(description="A scene, as `impasto scene` lists.")]


@router.post("/{name}/assets")
def make_scene(name: SceneName, context: Context, caller: Submitter) -> Asset:
    """A clip of 2.5 s (480x270 px, 12 frames a second) as an asset of yours; always the same bytes."""
    with tempfile.TemporaryDirectory() as folder:
        path = FilePath(folder) / f"{name}.mp4"
        write_clip(name, path)
        return adopt_made(context, caller, path)


def write_clip(name: str, path: FilePath) -> None:
    """Draw the scene and write it as MP4."""
    drawn = scene(name, SIZE, FRAMES, float(FPS))
    segment = path.with_suffix(".segment")
    with segment_writer(segment, SegmentSpec("mp4", SIZE, Fraction(1, FPS), float(FPS), 14)) as writer:
        for index in range(FRAMES):
            writer.write(index, drawn.image(index), index, index + 1)
    join([(Fraction(0), segment)], path, "mp4")
