"""`impasto report`: how steady, detailed, sharp and readable a painted video is, measured against its source."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import cv2
import typer
from pydantic import JsonValue

from impasto.cli.console import emit, out, print_status, print_table, table
from impasto.cli.options import JsonFlag
from pipeline.errors import BadInput

if TYPE_CHECKING:
    from pipeline.frames import Frame
    from pipeline.video.reader import VideoReader

EPILOG = """[bold]Examples[/bold]

impasto report clip.mp4 cartoon.mp4

impasto report clip.mp4 frames/ --pairs 20

impasto report clip.mp4 cartoon.mp4 --json | jq .flicker

The measures work for the result of any tool, not only of this one.
"""

_ASPECT_TOLERANCE = 0.01


def report(
    source: Annotated[Path, typer.Argument(metavar="SOURCE", help="The video before painting.")],
    result: Annotated[Path, typer.Argument(metavar="RESULT", help="The painted video, or a folder of frames.")],
    pairs: Annotated[
        int, typer.Option(min=0, help="Pairs of frames to measure, evenly spread over the video; 0: all.")
    ] = 0,
    as_json: JsonFlag = False,
) -> None:
    """Measure RESULT against SOURCE: flicker, detail, structure, edge width, faces kept."""
    from pipeline.quality.report import report_of
    from pipeline.video.reader import VideoReader

    for path in (source, result):
        if not path.exists():
            raise BadInput("File or folder not found.", field="SOURCE, RESULT", value=path)
    with VideoReader(source) as before, VideoReader(result) as after:
        _check_shapes(before, after)
        common = min(before.frames, after.frames)
        if before.frames != after.frames:
            print_status(f"SOURCE has {before.frames} frames, RESULT {after.frames}: the first {common} are compared.")
        found = report_of(_pairs(before, after, common, pairs)).as_json()
    emit({"frames": common, **found}) if as_json else _show(found)


def _check_shapes(source: VideoReader, result: VideoReader) -> None:
    (width, height), (other_width, other_height) = source.size, result.size
    if abs(width * other_height / (height * other_width) - 1) > _ASPECT_TOLERANCE:
        raise BadInput(
            f"SOURCE is {width}x{height} and RESULT {other_width}x{other_height}: their shapes differ.",
            field="RESULT",
            value=f"{other_width}x{other_height}",
            remedy="Compare videos of one aspect ratio.",
        )


Pair = tuple[int, "tuple[Frame, Frame]", "tuple[Frame, Frame]"]


def _pairs(source: VideoReader, result: VideoReader, frames: int, count: int) -> Iterator[Pair]:
    """(t, source frames t - 1 and t, result frames scaled to the source's size)."""
    from pipeline.quality.sampling import sampled_pairs

    if not count:
        both = zip(source.read(0, frames), _scaled(result.read(0, frames), source.size), strict=False)
        for number, (one, two) in enumerate(pairwise(both), start=1):
            yield number, (one[0], two[0]), (one[1], two[1])
        return
    for number in sampled_pairs(frames, count):
        first, second = source.read(number - 1, number + 1)
        painted_first, painted_second = _scaled(result.read(number - 1, number + 1), source.size)
        yield number, (first, second), (painted_first, painted_second)


def _scaled(frames: Iterator[Frame], size: tuple[int, int]) -> Iterator[Frame]:
    for frame in frames:
        same = (frame.shape[1], frame.shape[0]) == size
        yield frame if same else cv2.resize(frame, size, interpolation=cv2.INTER_AREA)  # type: ignore[misc]


ROWS = (
    ("flicker", "flicker", "1 = that of the source; less is better"),
    ("detail", "detail", "1 = as much as the source"),
    ("structure", "structure", "1 = the scene reads as in the source, 0 = not at all"),
    ("edge_width_px", "edge width, median (px)", "1 to 2 = drawn at this size"),
    ("edge_width_p90_px", "edge width, 90th percentile (px)", ""),
    ("faces_kept", "faces kept", "share of the faces found in the source"),
)


def _show(found: dict[str, JsonValue]) -> None:
    rows = table("measure", "value", "meaning")
    for key, title, meaning in ROWS:
        value = found.get(key)
        rows.add_row(title, "none" if value is None else f"{value:.3f}", meaning)
    print_table(rows)
    worst = found.get("worst")
    if isinstance(worst, list) and worst:
        out.print("most flicker at frame " + ", ".join(str(frame) for frame in worst))
