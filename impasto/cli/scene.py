"""`impasto scene`: procedural test clips, as a video or as frames with exact ground truth."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Annotated

import typer

from impasto.cli.console import emit, out, print_status, print_table, table
from impasto.cli.option_classes import takes_options
from impasto.cli.options import JsonFlag, OverwriteFlag, QuietFlag
from pipeline.errors import BadInput, BadParameter

EPILOG = """[bold]Examples[/bold]

impasto scene                                    what there is

impasto scene harbour -o harbour.mp4 --size 1280x720

impasto scene shapes -o shapes/ --frames 24      every pass: image, ids, velocities, normals, lines, occlusion
"""


@dataclass(frozen=True, kw_only=True)
class SceneOptions:
    """Options of `impasto scene`."""

    name: Annotated[str | None, typer.Argument(metavar="[NAME]", help="A scene; without a name: list the scenes.")] = (
        None
    )
    output: Annotated[
        str | None, typer.Option("--output", "-o", metavar="OUT", help="A .mp4, .webm or .zip file, or a folder: DIR/.")
    ] = None
    size: Annotated[str, typer.Option(metavar="WxH", help="Width and height, px.")] = "640x360"
    frames: Annotated[int | None, typer.Option(min=1, help="Number of frames; default: the scene's own.")] = None
    fps: Annotated[float, typer.Option(help="Frames per second.")] = 24.0
    seed: Annotated[int, typer.Option(min=0, help="Seed of textures and small shapes.")] = 0
    overwrite: OverwriteFlag = False
    quiet: QuietFlag = False
    as_json: JsonFlag = False


@takes_options(SceneOptions)
def scene(options: SceneOptions) -> None:
    """Draw a procedural scene: a test clip with exact motion.

    A folder gets every pass (described in its scene.json), a file gets the pictures.
    """
    from pipeline.scenes import scene as find

    if options.name is None:
        _list(options.as_json)
        return
    if options.output is None:
        remedy = f"Write: impasto scene {options.name} -o {options.name}.mp4"
        raise BadInput("The output is missing.", field="--output", remedy=remedy)
    from impasto.cli.scene_output import draw

    found = find(options.name, _size(options.size), options.frames, options.fps, options.seed)
    path = draw(found, options.output, options.overwrite, options.quiet)
    if options.as_json:
        emit({"scene": options.name, "output": str(path)})
    else:
        out.print(str(path), markup=False)


def _size(text: str) -> tuple[int, int]:
    if found := re.fullmatch(r"(\d{1,5})x(\d{1,5})", text):
        return int(found[1]), int(found[2])
    raise BadParameter("The size is width and height.", field="--size", value=text, remedy="Write --size 640x360.")


def _list(as_json: bool) -> None:
    from pipeline.scenes import scenes

    if as_json:
        emit([{"name": name, "about": about} for name, about in scenes().items()])
        return
    rows = table("scene", "what it shows")
    for name, about in scenes().items():
        rows.add_row(name, about)
    print_table(rows)
    print_status("Draw one with: impasto scene NAME -o NAME.mp4")
