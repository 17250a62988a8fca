"""Draws the figures of docs/patches.md, and writes its table of parameters.

python -m docs.make_patches_figures [MEDIA] [--only NAME ...]    NAME: pipeline, styles, time, table
"""

from __future__ import annotations

import argparse
import itertools
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks.patches_baseline import advected_strokes
from docs import parameters
from docs.pictures import CLIPS, DOCS, MEDIA, PAPER, frames, grid, save
from pipeline.frames import Frame, Labels
from pipeline.methods.base import Task
from pipeline.methods.local import LocalContext, run_plan
from pipeline.methods.patches import Patches, PatchesParams
from pipeline.methods.patches.appearance import (
    PanoramaRect,
    appearance_periods,
    colour_spans,
    colour_sum,
    period_picture,
)
from pipeline.methods.patches.artefacts import heat_map
from pipeline.methods.patches.clustering import LabelMaps
from pipeline.methods.patches.params import STROKE_STYLES
from pipeline.methods.patches.patch_construction import (
    WarpReader,
    concatenated_placements,
    patch_painter,
    relax_placements,
)
from pipeline.methods.patches.patch_track import PatchTrack
from pipeline.methods.patches.registration import Registration
from pipeline.methods.patches.scan import WorkingGrid
from pipeline.methods.patches.window_flow import WindowFlow
from pipeline.warp.panorama import Placement
from pipeline.warp.springs import distortion, relax

PAGE, FOLDER = DOCS / "patches.md", DOCS / "patches"
HEIGHT, LIMIT = 360, 230_000
SHOWN: Mapping[str, tuple[int, int, int]] = {
    "blackswan": (0, 20, 12), "coffee": (20, 32, 6), "bunny": (436, 460, 12),
}  # fmt: skip
"""Clip -> painted frames [start, stop), and the one that is shown."""
TITLES = {"video": "video", "on": "patches", "strokes": "strokes advected by flow", "off": "frame by frame"}
MARKS = ("<!-- parameters: written by docs/make_patches_figures.py -->", "<!-- end of parameters -->")
HUES = 0.618034
"""Difference of the hues of two successive labels, as a fraction of the circle; it separates any few hues well."""


@dataclass(frozen=True)
class Painted:
    """The shown part of a clip, its paintings, and what the method saved."""

    source: list[Frame]
    frames: list[Frame]
    context: LocalContext[PatchesParams]
    tasks: Mapping[str, list[Task]]

    @property
    def largest_object(self) -> PatchTrack:
        """The largest patch that is not the background."""
        tracks = [PatchTrack(**task.args["track"]) for task in self.tasks["patch"]]
        return max((track for track in tracks if track.label > 1), key=lambda track: (track.area, track.key))


def painted(clip: str, **params: Any) -> Painted:
    """Paint the shown part of a clip."""
    start, stop, _ = SHOWN[clip]
    source = list(frames(CLIPS[clip], MEDIA, start, stop, HEIGHT))
    context = LocalContext(PatchesParams(**params), source)
    tasks = run_plan(Patches(), context)
    context.step, context.task = "", None
    return Painted(source, [context.emitted[index] for index in range(len(source))], context, tasks)


def coloured(labels: Labels, frame: Frame) -> Frame:
    """A label map over its frame: one hue per label, white = background, black = unclustered."""
    count = int(labels.max()) + 1
    hues = np.arange(count) * HUES % 1 * 180
    shades = np.stack([hues, np.full(count, 190.0), np.full(count, 235.0)], axis=1).round().astype(np.uint8)
    table = cv2.cvtColor(shades[None], cv2.COLOR_HSV2RGB)[0]
    table[:2] = [[0, 0, 0], [255, 255, 255]][: len(table)]
    shown = cv2.resize(table[labels], frame.shape[1::-1], interpolation=cv2.INTER_NEAREST)
    return np.asarray(cv2.addWeighted(frame, 0.35, shown, 0.65, 0), np.uint8)


def boxed(picture_: Frame, shape: tuple[int, ...]) -> Frame:
    """A picture scaled to fit into a shape, centred on paper."""
    height, width = shape[:2]
    scale = min(height / picture_.shape[0], width / picture_.shape[1])
    size = max(1, round(picture_.shape[1] * scale)), max(1, round(picture_.shape[0] * scale))
    out = np.full((height, width, 3), PAPER, np.uint8)
    y, x = (height - size[1]) // 2, (width - size[0]) // 2
    out[y : y + size[1], x : x + size[0]] = cv2.resize(picture_, size, interpolation=cv2.INTER_AREA)
    return out


def panorama(
    placements: dict[int, Placement], track: PatchTrack, maps: LabelMaps, context: LocalContext[PatchesParams]
) -> Frame:
    """The mean of a patch's frames at these placements."""
    working_grid, params = WorkingGrid.of(context.size), context.params
    rect = PanoramaRect.around(placements, working_grid)
    sums = [colour_sum(span, track, placements, maps, rect, context) for span in colour_spans(track)]
    overall = appearance_periods(sums, track, rect, working_grid, params).overall
    return period_picture(sums, overall, rect, working_grid, params.misfit)


def distortion_maps(registration: Registration, track: PatchTrack) -> list[Frame]:
    """Distortion of the warp between two frames of a patch, before and after relaxation."""
    index = track.master + 1 if track.master + 1 < track.stop else track.master - 1
    region = registration.region(track, index)
    assert region is not None
    sheet = registration.spring_system(region, index)[2]
    planes = [distortion(sheet, positions) for positions in (sheet.targets, relax([sheet]).moved(sheet.targets))]
    top = np.float32(max(float(np.percentile(planes[0][region.mask], 99)), 1e-6))
    return [heat_map(plane / top) for plane in planes]


def pipeline() -> None:
    """Draw the stages of patches: frames of a swan are placed in a panorama, relaxed, painted and warped back."""
    swan = painted("blackswan")
    shown, track, context = SHOWN["blackswan"][2], swan.largest_object, swan.context
    maps, source = LabelMaps(context, track.begin), swan.source[shown]
    size = WorkingGrid.of(context.size).size
    registration = Registration(WindowFlow(context, track.begin), maps, context.params)
    before = concatenated_placements(track, lambda index: registration.warp(track, index, max_iterations=0), size)
    concatenated = concatenated_placements(track, WarpReader(track, context), size)
    after, _ = relax_placements(concatenated, track, maps, context.params)
    panoramas = [panorama(placements, track, maps, context) for placements in (before, after)]
    tiles = [
        source, coloured(maps.require(shown), source), patch_painter(track, context).paint_picture(panoramas[1]),
        swan.frames[shown], *panoramas, *distortion_maps(registration, track),
    ]  # fmt: skip
    names = [
        "a frame", "labels", "painted patch", "painted frame", "panorama, not relaxed", "relaxed",
        "distortion before", "after",
    ]  # fmt: skip
    save(grid([boxed(tile, source.shape) for tile in tiles], 2, names), FOLDER / "pipeline.jpg", LIMIT)


def styles() -> None:
    tiles = [painted("coffee", style=name).frames[SHOWN["coffee"][2]] for name in STROKE_STYLES]
    tiles.append(painted("coffee", style="impressionist", background_style="wash").frames[SHOWN["coffee"][2]])
    save(grid(tiles, 2, [*STROKE_STYLES, "impressionist on a background of wash"]), FOLDER / "styles.jpg", LIMIT)


def time() -> None:
    """Draw a row of pixels over time, of the video, of patches and of both baselines."""
    start, stop, _ = SHOWN["bunny"]
    source = list(frames(CLIPS["bunny"], MEDIA, start, stop, HEIGHT))
    made = {mode: painted("bunny", temporal=mode).frames for mode in ("on", "off")}
    made["strokes"] = advected_strokes(source, PatchesParams())
    tiles, names = [], []
    for name, video in (("video", source), *made.items()):
        tiles.append(slit(video))
        names.append(TITLES[name])
    save(grid(tiles, 2, names), FOLDER / "slits.jpg", LIMIT)


def slit(video: list[Frame], thick: int = 8) -> Frame:
    """The middle row of every frame, one below the other, each `thick` px high."""
    rows = [frame[frame.shape[0] // 2] for frame in video]
    return np.ascontiguousarray(np.repeat(np.stack(rows), thick, axis=0))


def parameters_table() -> Iterator[str]:
    properties: Mapping[str, Mapping[str, Any]] = PatchesParams.model_json_schema()["properties"]
    for group, members in itertools.groupby(properties.items(), key=lambda item: item[1]["group"]):
        yield f"### {group}"
        yield ""
        yield from parameters.table(dict(members))
        yield ""


def table() -> None:
    """Write the table of parameters between its markers."""
    begin, end = MARKS
    before, _, after = PAGE.read_text().partition(begin)
    rows = "\n".join(parameters_table())
    PAGE.write_text(f"{before}{begin}\n\n{rows}{end}{after.partition(end)[2]}")


ALL: Mapping[str, Callable[[], None]] = {"pipeline": pipeline, "styles": styles, "time": time, "table": table}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("media", nargs="?", type=Path, default=MEDIA)
    parser.add_argument("--only", nargs="+", choices=ALL, default=list(ALL))
    args = parser.parse_args()
    globals()["MEDIA"] = args.media
    for name in args.only:
        ALL[name]()


if __name__ == "__main__":
    main()
