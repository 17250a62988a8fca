"""Step "patch": painting patches are constructed from the registered frames and painted once (section 5).

The warps of a patch are concatenated from the master frame outward and relaxed jointly, which places every frame in the
panorama. The colours are averaged there, and the mean is painted.

    <patch>-placement   relaxed placement in each frame, rectangle of the panorama, and faces in it
    <patch>-sum-<n>     colour sums of the n-th span of frames and of some after it
    <patch>             division into periods of similar appearance
    <patch>-period-<n>  mean and painting of the periods that begin with these spans

Small patches do all of this in a single task, <patch>. Large ones, such as backgrounds, are divided as listed.

Source: zhang2011patches, section 5.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pipeline.arrays import State
from pipeline.frames import Frame, Mask
from pipeline.kernels.ahead import helpers
from pipeline.kernels.executors import FrameExecutor
from pipeline.kernels.float16 import to_half, to_single
from pipeline.methods.base import PlanContext, Task, TaskContext, TaskResult
from pipeline.methods.patches.appearance import (
    AppearancePeriods,
    ColourSum,
    PanoramaRect,
    appearance_periods,
    colour_spans,
    colour_sum,
    period_picture,
)
from pipeline.methods.patches.artefacts import save_energy_artefact, save_patch_artefact
from pipeline.methods.patches.clustering import LabelMaps
from pipeline.methods.patches.frame_passes import STROKE_IDS
from pipeline.methods.patches.painter import HertzmannPainter
from pipeline.methods.patches.panorama_faces import Weights, as_planes, load_weights, panorama_weights, save_weights
from pipeline.methods.patches.params import PatchesParams
from pipeline.methods.patches.patch_styles import label_styles, params_of
from pipeline.methods.patches.patch_track import PatchTrack, patch_tracks
from pipeline.methods.patches.registration import FrameWarp, load_warps, save_warps
from pipeline.methods.patches.scan import WorkingGrid, document, run_key, run_start
from pipeline.strokes.raster import StrokeTrace
from pipeline.warp.homography import IDENTITY, Homography
from pipeline.warp.panorama import Placement
from pipeline.warp.springs import Relaxed, Sheet, distortion, relax

SINGLE_TASK_AREA = 6.0
"""Area of a patch summed over its frames, in frame areas, below which it is a single task."""
MOST_PARTS = 12
"""Largest number of tasks that sum the colours of a large patch, and that paint it: each costs a claim and loads the
sum of all frames."""
STRIDE = 2
"""Subsampling of pixels in the joint relaxation."""
MAX_SHEETS = 24
"""Largest number of frames in the joint relaxation. Neighbouring frames are redundant, so an even sample suffices."""
CELL_PX = 4.0
"""Cell size of the grid of the joint relaxation, working px."""

# -- plan


def plan_patch(context: PlanContext[PatchesParams]) -> list[Task]:
    """One task per small patch, several per large patch; none without painting patches."""
    if context.params.temporal != "on":
        return []
    width, height = WorkingGrid.of((context.video.width, context.video.height)).size
    pairs, tasks = _pair_energies(context), list[Task]()
    for track in patch_tracks(context):
        args = {"track": track.args(context.params.table_area), "pairs": pairs.get(track.key, [0.0, 0.0, 0, 0])}
        if track.area < SINGLE_TASK_AREA * width * height:
            tasks.append(Task(track.key, args, weight=0.07 * (track.stop - track.start) + 0.7))
        else:
            tasks += _part_tasks(track, args)
    return sorted(tasks, key=lambda task: len(task.after))


def _part_tasks(track: PatchTrack, args: TaskResult) -> list[Task]:
    """Tasks of a large patch. Each task has more dependencies than any task that it depends on."""
    key, count = track.key, len(colour_spans(track))
    placement = Task(f"{key}-placement", {**args, "part": "placement"}, weight=0.03 * (track.stop - track.start))
    size = math.ceil(count / MOST_PARTS)
    groups = [range(first, min(first + size, count)) for first in range(0, count, size)]
    sums = [_part_task(key, args["track"], "sum", group, (placement.key,), 0.3) for group in groups]
    needs = (placement.key, *(task.key for task in sums))
    periods = Task(key, {"track": args["track"], "part": "periods"}, needs, weight=0.035 * count)
    paintings = [_part_task(key, args["track"], "period", group, (*needs, key), 0.7 / count) for group in groups]
    return [placement, *sums, periods, *paintings]


def _part_task(
    key: str, track: TaskResult, part: str, spans: Sequence[int], after: tuple[str, ...], weight: float
) -> Task:  # fmt: skip
    """A task for spans with these numbers; `weight` of each."""
    args = {"track": track, "part": part, "spans": list(spans)}
    return Task(f"{key}-{part}-{spans[0]}", args, after, weight=weight * len(spans))


def _pair_energies(context: PlanContext[PatchesParams]) -> dict[str, list[float]]:
    """Sums over the frame pairs of each patch: energy before and after relaxation, iterations, number of pairs."""
    found: dict[str, list[float]] = {}
    for result in context.results["register"].values():
        for key, row in result["energies"].items():
            found[key] = [a + b for a, b in zip(found.get(key, [0.0, 0.0, 0, 0]), row, strict=True)]
    return found


# -- run


def run_patch(task: Task, context: TaskContext[PatchesParams]) -> TaskResult:
    """Run one part of the construction of a patch.

    Artefacts: "<patch>-<run>" with the placements of a run's frames, "<patch>-period<n>" with a panorama and its
    painting. The result of the task <patch> holds the panorama's origin, px, and the frames of each period.
    """
    parts: Mapping[str, Callable[[Task, PatchTrack, TaskContext[PatchesParams]], TaskResult]] = {
        "whole": _run_whole, "placement": _run_placement, "sum": _run_sum, "periods": _run_periods,
        "period": _run_period,
    }  # fmt: skip
    return parts[task.args.get("part", "whole")](task, PatchTrack(**task.args["track"]), context)


def _run_whole(task: Task, track: PatchTrack, context: TaskContext[PatchesParams]) -> TaskResult:
    maps, grid = LabelMaps(context, track.begin), WorkingGrid.of(context.size)
    placements, rect, result = _place(task, track, maps, context)
    with context.clock("faces"):
        faces = panorama_weights(track, placements, maps, rect, context)
    with context.clock("mean"):
        sums = {span: colour_sum(span, track, placements, maps, rect, context) for span in colour_spans(track)}
        periods = appearance_periods(sums.values(), track, rect, grid, context.params)
    for number, (start, stop) in enumerate(periods.spans):
        of_period = (part for span, part in sums.items() if start <= span[0] < stop)
        _paint_period(number, start, of_period, periods.overall, faces, track, rect, context)
        context.progress(0.5 + 0.5 * (number + 1) / len(periods.spans))
    return result | _period_result(periods, rect)


def _run_placement(task: Task, track: PatchTrack, context: TaskContext[PatchesParams]) -> TaskResult:
    maps = LabelMaps(context, track.begin)
    placements, rect, result = _place(task, track, maps, context)
    rect.save(context, track)
    with context.clock("faces"):
        save_weights(context, track, panorama_weights(track, placements, maps, rect, context))
    return result


def _run_sum(task: Task, track: PatchTrack, context: TaskContext[PatchesParams]) -> TaskResult:
    rect, maps = PanoramaRect.load(context, track), LabelMaps(context, track.begin)
    for number in task.args["spans"]:
        span = colour_spans(track)[number]
        placements = load_placements(context, track, *span)
        with context.clock("mean"):
            colour_sum(span, track, placements, maps, rect, context).save(context, f"{track.key}-sum-{number}")
    return {}


def _run_periods(task: Task, track: PatchTrack, context: TaskContext[PatchesParams]) -> TaskResult:
    rect, grid = PanoramaRect.load(context, track), WorkingGrid.of(context.size)
    sums = _load_sums(track, track.start, track.stop, context)
    with context.clock("mean"):
        periods = appearance_periods(sums, track, rect, grid, context.params)
    periods.save(context, track)
    return _period_result(periods, rect)


def _run_period(task: Task, track: PatchTrack, context: TaskContext[PatchesParams]) -> TaskResult:
    starts = {colour_spans(track)[number][0] for number in task.args["spans"]}
    periods, rect = AppearancePeriods.load(context, track), PanoramaRect.load(context, track)
    for number, (start, stop) in enumerate(periods.spans):
        if start in starts:
            sums, faces = _load_sums(track, start, stop, context), load_weights(context, track)
            _paint_period(number, start, sums, periods.overall, faces, track, rect, context)
    return {}


def _load_sums(
    track: PatchTrack, start: int, stop: int, context: TaskContext[PatchesParams]
) -> Iterable[ColourSum]:  # fmt: skip
    numbers = [number for number, span in enumerate(colour_spans(track)) if start <= span[0] < stop]
    return (ColourSum.load(context, f"{track.key}-sum-{number}") for number in numbers)


def _period_result(periods: AppearancePeriods, rect: PanoramaRect) -> TaskResult:
    """Result of a patch's task, as the step "paint" reads it."""
    return {"origin": list(rect.origin), "periods": [list(span) for span in periods.spans]}


def _place(
    task: Task, track: PatchTrack, maps: LabelMaps, context: TaskContext[PatchesParams]
) -> tuple[dict[int, Placement], PanoramaRect, TaskResult]:
    """Concatenate and relax the warps of a patch, and save its placements."""
    grid = WorkingGrid.of(context.size)
    with context.clock("join"):
        concatenated = concatenated_placements(track, WarpReader(track, context), grid.size)
    with context.clock("relax"):
        placements, relaxed = relax_placements(concatenated, track, maps, context.params)
    save_placements(context, track, placements)
    if context.wants("energy"):
        _report_energy(task, track, concatenated, placements, maps, relaxed, context)
    energies = {"before": relaxed.before, "after": relaxed.after, "iterations": relaxed.iterations}
    return placements, PanoramaRect.around(placements, grid), {**energies, "frames": len(placements)}


def _report_energy(
    task: Task, track: PatchTrack, before: dict[int, Placement], after: dict[int, Placement], maps: LabelMaps,
    relaxed: Relaxed, context: TaskContext[PatchesParams],
) -> None:  # fmt: skip
    """Save the energies, and distortion maps of the frame furthest from the master frame."""
    index = max(after, key=lambda frame: (abs(frame - track.master), frame))
    sheet = spring_system(before[index], maps.require(index) == track.label, context.params, 1)
    pairs = dict(zip(("before", "after", "iterations", "pairs"), task.args["pairs"], strict=True))
    report = {
        "label": track.label, "frames": [track.start, track.stop], "master": track.master, "pairs": pairs,
        "all": {"before": relaxed.before, "after": relaxed.after, "iterations": relaxed.iterations}, "map": index,
    }  # fmt: skip
    distortions = [distortion(sheet, placements[index].positions()) for placements in (before, after)]
    save_energy_artefact(context, track.key, report, distortions[0], distortions[1])


def _paint_period(
    number: int, start: int, sums: Iterable[ColourSum], overall: ColourSum, faces: Weights | None, track: PatchTrack,
    rect: PanoramaRect, context: TaskContext[PatchesParams],
) -> None:  # fmt: skip
    """Compute and save panorama and painting of one period that begins at the frame `start`."""
    with context.clock("mean"):
        misfit = context.params.at(start).misfit
        panorama: Frame = period_picture(sums, overall, rect, WorkingGrid.of(context.size), misfit)
    painter, size = patch_painter(track, context), panorama.shape[:2]
    if context.wants_pass(STROKE_IDS):
        painter = replace(painter, trace=StrokeTrace(np.zeros(size, np.uint32), np.zeros(size, np.float32)))
    with context.clock("paint"), helpers(1, "impasto-layers") as threads:
        painting = painter.paint_picture(panorama, as_planes(faces), FrameExecutor(threads))
    arrays: State = {"panorama": panorama, "painting": painting}
    if painter.trace is not None:
        own = np.uint32(zlib.crc32(period_artefact(track, number).encode()))
        arrays["strokes"] = np.where(painter.trace.owners > 0, painter.trace.owners ^ own, 0).astype(np.uint32)
    context.save(period_artefact(track, number), arrays)
    save_patch_artefact(context, track.key, number, panorama, painting)


def period_artefact(track: PatchTrack, number: int) -> str:
    """Name of the artefact with "panorama", uint8 (h, w, 3), and "painting" of a period, uint8 or uint16 (h, w, 3);
    and "strokes", uint32 (h, w), the number of the stroke at each pixel, if that pass is wanted."""
    return f"{track.key}-period{number}"


def patch_painter(track: PatchTrack, context: TaskContext[PatchesParams]) -> HertzmannPainter:
    """Painter of a patch: brush sizes from table 1 by the patch's area, and the patch's own parameters."""
    styles, ratio = label_styles(document(context, "styles", {})), WorkingGrid.of(context.size).ratio
    own = params_of(track.label, context.params, styles, track.background)
    area_px = track.table_area(own.table_area) * ratio[0] * ratio[1]
    return HertzmannPainter.of(own.style, area_px, min(context.size), own, context.seed, context.deep)


# -- placement of the frames in the panorama


def concatenated_placements(
    track: PatchTrack, warps: Callable[[int], FrameWarp | None], size: tuple[int, int]
) -> dict[int, Placement]:
    """Placement of the patch in each frame that contains it, from warps concatenated outward from the master frame.

    Args:
        warps: returns the warp of a frame, see `WarpReader`; the master frame must have one.
        size: (width, height) of a frame, working px.
    """
    first = warps(track.master)
    assert first is not None, "the master frame has the patch"
    placements = {track.master: Placement(first.rect, IDENTITY, first.displacement)}
    for order in (range(track.master + 1, track.stop), range(track.master - 1, track.start - 1, -1)):
        for index in order:
            warp = warps(index)
            if warp is not None and index + warp.gap in placements:
                placements[index] = _concatenated(warp, placements[index + warp.gap], size)
    return dict(sorted(placements.items()))


@dataclass
class WarpReader:
    """Loads the warps of one patch, holding one run in memory."""

    track: PatchTrack
    context: TaskContext[PatchesParams]
    _run: dict[int, dict[int, FrameWarp]] = field(default_factory=dict)

    def __call__(self, index: int) -> FrameWarp | None:
        """Warp of frame `index`; None if the frame does not contain the patch."""
        start = run_start(index, self.track.begin)
        if start not in self._run:
            self._run = {start: load_warps(self.context, f"{self.track.key}-{run_key(start)}")}
        return self._run[start].get(index)


def _concatenated(warp: FrameWarp, target: Placement, size: tuple[int, int]) -> Placement:
    """Placement of a frame: its warp, followed by the placement of the warp's target frame."""
    warped = Placement(warp.rect, IDENTITY, warp.displacement).positions()
    positions = target.at(warped)
    matrix = target.matrix @ warp.matrix
    matrix = matrix / matrix[2, 2]
    if not _is_regular(matrix, size):
        matrix = target.matrix
    plane = Placement(warp.rect, matrix, np.zeros_like(warp.displacement)).positions()
    return Placement(warp.rect, matrix, to_half(positions - plane))


def _is_regular(matrix: Homography, size: tuple[int, int]) -> bool:
    """Whether the homography is free of folds and extreme scales over a frame of this size."""
    corners = np.array([[x, y, 1.0] for x in (0, size[0]) for y in (0, size[1])])
    depth = corners @ matrix[2]
    scale = abs(np.linalg.det(matrix[:2, :2]))
    return bool(np.isfinite(matrix).all() and depth.min() > 0.3 and depth.max() < 3 and 0.05 < scale < 20)


def relax_placements(
    placements: Mapping[int, Placement], track: PatchTrack, maps: LabelMaps, params: PatchesParams
) -> tuple[dict[int, Placement], Relaxed]:
    """Relax the patch over all frames on one grid; returns the relaxed placements, and the energies."""
    sheets = [
        spring_system(placements[index], maps.require(index) == track.label, params, STRIDE)
        for index in evenly_spaced(list(placements), MAX_SHEETS)
    ]
    relaxed = relax(sheets, CELL_PX)
    moved = {}
    for index, placement in placements.items():
        positions = placement.positions()
        residual = to_single(placement.residual) + (relaxed.moved(positions) - positions)
        moved[index] = Placement(placement.rect, placement.matrix, to_half(residual))
    return moved, relaxed


def spring_system(placement: Placement, inside: Mask, params: PatchesParams, stride: int) -> Sheet:
    """Spring system of every `stride`-th pixel of the patch in a frame, with its placement as the target.

    Args:
        inside: bool (h, w), the patch's cluster in the whole frame, at the working size.
    """
    left, top, right, bottom = placement.rect
    mask = np.ascontiguousarray(inside[top:bottom:stride, left:right:stride])
    scale = float(np.sqrt(abs(np.linalg.det(placement.matrix[:2, :2]))))
    targets = np.ascontiguousarray(placement.positions()[::stride, ::stride])
    return Sheet(targets, mask, np.full(mask.shape, params.stiffness, np.float32), scale * stride)


def evenly_spaced(items: list[int], most: int) -> list[int]:
    """Choose at most `most` items, evenly spaced, including both ends."""
    if len(items) <= most:
        return items
    return [items[place] for place in np.linspace(0, len(items) - 1, most).round().astype(int).tolist()]


def save_placements(
    context: TaskContext[PatchesParams], track: PatchTrack, placements: Mapping[int, Placement]
) -> None:  # fmt: skip
    """Save the placements by run as artefacts "<patch>-<run>"."""
    by_run: dict[int, dict[int, FrameWarp]] = {
        run_start(index, track.begin): {} for index in range(track.start, track.stop)
    }  # fmt: skip
    for index, placement in placements.items():
        warp = FrameWarp(placement.rect, 0, placement.matrix, placement.residual)
        by_run[run_start(index, track.begin)][index] = warp
    for start, warps in by_run.items():
        save_warps(context, f"{track.key}-{run_key(start)}", warps)


def load_placements(
    context: TaskContext[PatchesParams], track: PatchTrack, start: int, stop: int
) -> dict[int, Placement]:  # fmt: skip
    """Load the placements of the frames [start, stop) that contain the patch."""
    placements = {}
    frames = range(max(start, track.start), min(stop, track.stop))
    for run in sorted({run_start(index, track.begin) for index in frames}):
        for index, warp in load_warps(context, f"{track.key}-{run_key(run)}", "patch").items():
            if start <= index < stop:
                placements[index] = Placement(warp.rect, warp.matrix, warp.displacement)
    return placements
