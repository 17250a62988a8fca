"""`impasto inspect`: what a sequence or video holds, and what each method would use of it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from impasto.cli.console import emit, out, print_status
from impasto.cli.option_classes import takes_options
from impasto.cli.options import (
    FpsOption,
    JsonFlag,
    LayerOption,
    MissingOption,
    OverwriteFlag,
    VectorsOption,
    ViewOption,
    extracted_of,
    sequence_of,
)
from impasto.delivery import check_new

if TYPE_CHECKING:
    from impasto.inspection import Report

EPILOG = """[bold]Examples[/bold]

impasto inspect shot/beauty.####.png

impasto inspect shot/ --json | jq .passes.vectors

impasto inspect shot/ --extract matte:Cube=cube.zip --extract ids=labels.zip
"""


@dataclass(frozen=True, kw_only=True)
class InspectOptions:
    """Options of `impasto inspect`."""

    path: Annotated[Path, typer.Argument(metavar="PATH", help="A video, an image, a folder, or name.####.png.")]
    extract: Annotated[
        list[str] | None,
        typer.Option(
            metavar="PASS=PATH",
            help="Also write a pass as a zip of images: matte:OBJECT, ids, motion, depth, normals, position, uv.",
        ),
    ] = None
    missing: MissingOption = None
    fps: FpsOption = None
    layer: LayerOption = None
    view: ViewOption = None
    vectors: VectorsOption = None
    overwrite: OverwriteFlag = False
    as_json: JsonFlag = False


@takes_options(InspectOptions)
def inspect(options: InspectOptions) -> None:
    """List what a sequence or video holds: size, frame range, colour, layers and passes, and what each method would use
    of them."""
    from impasto.inspection import inspect as look

    wanted = extracted_of(options.extract or ())
    for name, to in wanted.items():
        check_new(to, options.overwrite, f"--extract {name}")
    report = look(
        options.path, sequence_of(options.missing, options.fps, options.layer, options.view, options.vectors), wanted
    )
    if options.as_json:
        emit({**report, "extracted": {name: str(to) for name, to in wanted.items()}})
        return
    for line in _lines(report):
        out.print(line, markup=False, highlight=False, soft_wrap=True)
    for name, to in wanted.items():
        print_status(f"{name}: {to}")


def _lines(report: Report) -> Iterator[str]:
    """The report as text."""
    size, count = f"{report['width']}x{report['height']} px", report["frames"]
    yield f"{report['path']}: {report['media_type']}, {size}, {count} frames at {report['fps']:g} per second"
    for title, value in _facts(report):
        yield f"  {title:<13} {value}"
    for note in report["notes"]:
        yield f"  note          {note}"
    if fault := report["fault"]:
        yield f"  no sequence   {fault['message']} {fault['value']} {fault['remedy']}"
    if not report["passes"]:
        return
    finding = (report["passes"].get("vectors") or {}).get("message", "")
    if finding:
        yield finding
    for name, told in report["methods"].items():
        used = ["Motion: see above." if sentence == finding else sentence for sentence in told]
        yield f"{name}: {' '.join(used) or 'It uses no passes.'}"


def _facts(report: Report) -> Iterator[tuple[str, Any]]:
    if report["numbers"]:
        yield "numbers", ", ".join(_run(*run) for run in report["numbers"])
    for name in ("timecode", "pixel_format", "codec"):
        if report.get(name):
            yield name.replace("_", " "), report[name]
    if report["alpha"]:
        yield "opacity", "yes"
    if report["sounds"]:
        yield "sound tracks", report["sounds"]
    if report["damage"]:
        yield "damage", report["damage"]
    passes = report["passes"]
    if not passes:
        return
    yield "picture", passes["layer"] or "(no name)"
    yield "layers", ", ".join(layer or "(no name)" for layer in passes["layers"])
    if passes["views"]:
        yield "views", ", ".join(passes["views"])
    for kind, found in passes["passes"].items():
        yield kind, f"{found['layer'] or ', '.join(found['channels'])}, as {found['programs']} names it"
    if passes["mattes"]:
        yield "cryptomatte", ", ".join(passes["mattes"])


def _run(first: int, last: int, step: int) -> str:
    return f"{first} to {last}" + (f" by {step}" if step != 1 else "") if last != first else str(first)
