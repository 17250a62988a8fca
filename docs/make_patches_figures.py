"""The pictures of docs/patches.md, and its table of parameters from the schema.

python -m docs.make_patches_figures [MEDIA] [--only NAME ...]    NAME: pipeline, styles, time, table
"""

from __future__ import annotations

import argparse
import itertools
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks.patches import Table, run
from docs import parameters
from docs.pictures import CLIPS, DOCS, MEDIA, PAPER, frames, grid, save
from pipeline.frames import Frame, Labels
from pipeline.methods import parse_params
from pipeline.methods.patches import Patches, PatchesParams
from pipeline.methods.patches.ages import Room, ages, picture, spans, sum_up
from pipeline.methods.patches.artefacts import heat
from pipeline.methods.patches.build import painter_of
from pipeline.methods.patches.clusters import LabelMaps
from pipeline.methods.patches.grid import Grid
from pipeline.methods.patches.join import Hops, joined, settle
from pipeline.methods.patches.links import Links
from pipeline.methods.patches.lives import Life
from pipeline.methods.patches.register import Views
from pipeline.methods.patches.scan import RUN
from pipeline.methods.patches.styles import STYLES
from pipeline.warp.panorama import Lay
from pipeline.warp.springs import distortion, relax

PAGE, FOLDER = DOCS / "patches.md", DOCS / "patches"
HEIGHT, LIMIT = 360, 230_000
SHOWN: Mapping[str, tuple[int, int, int]] = {
    "blackswan": (0, 20, 12), "coffee": (20, 32, 6), "bunny": (436, 460, 12),
}  # fmt: skip
"""Clip -> frames [start, stop) that are painted, and which of them is shown."""
TOLD = {"video": "video", "on": "patches", "strokes": "strokes carried by flow", "off": "frame by frame"}
MARKS = ("<!-- parameters: written by docs/make_patches_figures.py -->", "<!-- end of parameters -->")
HUES = 0.618034
"""Part of a turn between the hues of two labels in a row: far apart for any few."""


def painted(clip: str, **params: Any) -> tuple[Table, list[Frame]]:
    """The shown part of a clip, painted: the context with all that was kept, and the frames."""
    start, stop, _ = SHOWN[clip]
    source = list(frames(CLIPS[clip], MEDIA, start, stop, HEIGHT))
    context = Table(parse_params(Patches(), params), source)
    run(context)
    return context, [context.emitted[index] for index in range(len(source))]


def coloured(labels: Labels, frame: Frame) -> Frame:
    """A label map over its frame: a hue a label, white the background, black what is unclustered."""
    count = int(labels.max()) + 1
    hues = np.arange(count) * HUES % 1 * 180
    shades = np.stack([hues, np.full(count, 190.0), np.full(count, 235.0)], axis=1).round().astype(np.uint8)
    table = cv2.cvtColor(shades[None], cv2.COLOR_HSV2RGB)[0]
    table[:2] = [[0, 0, 0], [255, 255, 255]][: len(table)]
    shown = cv2.resize(table[labels], frame.shape[1::-1], interpolation=cv2.INTER_NEAREST)
    return np.asarray(cv2.addWeighted(frame, 0.35, shown, 0.65, 0), np.uint8)


def boxed(picture_: Frame, shape: tuple[int, ...]) -> Frame:
    """A picture of any shape, whole, on paper of one."""
    height, width = shape[:2]
    scale = min(height / picture_.shape[0], width / picture_.shape[1])
    size = max(1, round(picture_.shape[1] * scale)), max(1, round(picture_.shape[0] * scale))
    out = np.full((height, width, 3), PAPER, np.uint8)
    y, x = (height - size[1]) // 2, (width - size[0]) // 2
    out[y : y + size[1], x : x + size[0]] = cv2.resize(picture_, size, interpolation=cv2.INTER_AREA)
    return out


def patch_life(context: Table) -> Life:
    """The largest patch that is not the background."""
    rows = [Life(**task.args["life"]) for task, _ in context.spent["patch"]]
    return max((life for life in rows if life.label > 1), key=lambda life: (life.area, life.key))


def panorama(lays: dict[int, Lay], life: Life, maps: LabelMaps, context: Table) -> Frame:
    """The mean of a patch's frames as they are laid."""
    room, grid_ = Room.around(lays, Grid.of(context.size)), Grid.of(context.size)
    sums = [sum_up(span, life, lays, maps, room, context) for span in spans(life)]
    return picture(sums, ages(sums, life, room, grid_, context.params).every, room, grid_, context.params.misfit)


def strains(views: Views, life: Life) -> list[Frame]:
    """Where the warp between two frames of a patch is distorted, before and after relaxation."""
    index = life.master + 1 if life.master + 1 < life.stop else life.master - 1
    here = views.here(life, index)
    assert here is not None
    sheet = views.sheet(here, index)[2]
    planes = [distortion(sheet, laid) for laid in (sheet.targets, relax([sheet]).moved(sheet.targets))]
    top = np.float32(max(float(np.percentile(planes[0][here.mask], 99)), 1e-6))
    return [heat(plane / top) for plane in planes]


def pipeline() -> None:
    """From labels to the painting: a swan is laid over itself, relaxed, painted, and carried back."""
    context, made = painted("blackswan")
    shown, life = SHOWN["blackswan"][2], patch_life(context)
    maps, source = LabelMaps(context, life.begin), context.clip[shown]
    size = Grid.of(context.size).size
    views = Views(Links(context, life.begin, RUN), maps, context.params)
    before = joined(life, lambda index: views.hop(life, index, most=0), size)
    after = joined(life, Hops(life, context), size)
    settle(after, life, maps, context.params)
    laid = [panorama(lays, life, maps, context) for lays in (before, after)]
    strain = strains(views, life)
    tiles = [
        source, coloured(maps.sure(shown), source), painter_of(life, context).picture(laid[1]), made[shown],
        *laid, *strain,
    ]  # fmt: skip
    names = [
        "a frame", "labels", "painted patch", "painted frame", "panorama, not relaxed", "relaxed",
        "distortion before", "after",
    ]  # fmt: skip
    save(grid([boxed(tile, source.shape) for tile in tiles], 2, names), FOLDER / "pipeline.jpg", LIMIT)


def styles() -> None:
    tiles = [painted("coffee", style=name)[1][SHOWN["coffee"][2]] for name in STYLES]
    tiles.append(painted("coffee", style="impressionist", background_style="wash")[1][SHOWN["coffee"][2]])
    save(grid(tiles, 2, [*STYLES, "impressionist on a background of wash"]), FOLDER / "styles.jpg", LIMIT)


def time() -> None:
    """A row of pixels over time, of the video, of patches and of both baselines; and a corner in three frames."""
    start, stop, _ = SHOWN["bunny"]
    source = list(frames(CLIPS["bunny"], MEDIA, start, stop, HEIGHT))
    made = {mode: painted("bunny", temporal=mode)[1] for mode in ("on", "strokes", "off")}
    tiles, names = [], []
    for name, video in (("video", source), *made.items()):
        tiles.append(slit(video))
        names.append(TOLD[name])
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
    """Put the table between its marks."""
    begin, end = MARKS
    before, _, rest = PAGE.read_text().partition(begin)
    PAGE.write_text(f"{before}{begin}\n\n" + "\n".join(parameters_table()) + f"{end}{rest.partition(end)[2]}")


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
