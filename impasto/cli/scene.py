"""`impasto scene`: procedural test clips, as a video or as frames with exact ground truth."""

from __future__ import annotations

import re
from typing import Annotated

import typer

from impasto.cli.console import emit, out, print_status, print_table, table
from impasto.cli.options import JsonFlag, QuietFlag
from pipeline.errors import BadInput, BadParameter

EPILOG = """[bold]Examples[/bold]

impasto scene                                    what there is

impasto scene harbour -o harbour.mp4 --size 1280x720

impasto scene shapes -o shapes/ --frames 24      every pass: image, ids, velocities, normals, lines, occlusion
"""


def scene(
    name: Annotated[
        str | None, typer.Argument(metavar="[NAME]", help="A scene; without a name: list the scenes.")
    ] = None,
    output: Annotated[
        str | None, typer.Option("--output", "-o", metavar="OUT", help="A .mp4, .webm or .zip file, or a folder: DIR/.")
    ] = None,
    size: Annotated[str, typer.Option(metavar="WxH", help="Width and height, px.")] = "640x360",
    frames: Annotated[int | None, typer.Option(min=1, help="Number of frames; default: the scene's own.")] = None,
    fps: Annotated[float, typer.Option(help="Frames per second.")] = 24.0,
    seed: Annotated[int, typer.Option(min=0, help="Seed of textures and small shapes.")] = 0,
    quiet: QuietFlag = False,
    as_json: JsonFlag = False,
) -> None:
    """Draw a procedural scene: a test clip with exact motion.

    A folder gets every pass (described in its scene.json), a file gets the pictures.
    """
    from pipeline.scenes import scene as find

    if name is None:
        _list(as_json)
        return
    if output is None:
        raise BadInput("The output is missing.", field="--output", remedy=f"Write: impasto scene {name} -o {name}.mp4")
    from impasto.cli.scene_output import draw

    path = draw(find(name, _size(size), frames, fps, seed), output, quiet)
    if as_json:
        emit({"scene": name, "output": str(path)})
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
