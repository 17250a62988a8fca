"""Step "patch": join a patch's warps, relax them together, take its mean colours, and paint it: once (section 5)."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Frame, Mask, Plane
from pipeline.methods.base import Bench, Brief, Note, Task
from pipeline.methods.patches.artefacts import keep_energy, keep_patch
from pipeline.methods.patches.clusters import LabelMaps
from pipeline.methods.patches.grid import Grid
from pipeline.methods.patches.guidance import style_of, styles_of
from pipeline.methods.patches.hertzmann import PAPER_HEIGHT, Painter
from pipeline.methods.patches.links import norm
from pipeline.methods.patches.lives import Life, lives
from pipeline.methods.patches.params import PatchesParams
from pipeline.methods.patches.register import MARGIN, rect_of
from pipeline.methods.patches.scan import run_key, run_of
from pipeline.warp.homography import IDENTITY, Homography
from pipeline.warp.panorama import Lay, full_map, gather, mean
from pipeline.warp.springs import Relaxed, Sheet, distortion, relax

STRIDE = 2
"""Every second pixel is enough for the relaxation over all frames."""
MOST_SHEETS = 24
"""Frames of a life that are relaxed together: neighbours say nearly the same, so an even choice stands for all."""
CELL = 4.0
"""Distance of its grid's corners, working px."""
LARGEST = 16.0
"""Area of a panorama, in frames: what lies beyond keeps its border's paint."""
AGE = 8
"""Frames whose mean is compared with what the patch has looked like so far."""
CHANGED = 0.015
"""Part of a patch's pixels that has to look different for a new age to begin."""
OUTSIDE = 0.02
"""Weight of a frame's colours beyond the cluster, in the margin, beside 1 within."""


def plan_patch(brief: Brief) -> list[Task]:
    if brief.params.temporal != "on":
        return []
    pairs = _pair_energies(brief)
    return [
        Task(life.key, {"life": life.args(), "pairs": pairs.get(life.key, [0.0, 0.0, 0, 0])}, weight=_weight(life))
        for life in lives(brief)
    ]


def _weight(life: Life) -> float:
    return 0.1 * (life.stop - life.start) + 1


def _pair_energies(brief: Brief) -> dict[str, list[float]]:
    """Of each patch, over all its pairs of frames: energy before and after, iterations, and how many pairs."""
    found: dict[str, list[float]] = {}
    for note in brief.notes["register"].values():
        for key, row in note["energies"].items():
            found[key] = [a + b for a, b in zip(found.get(key, [0.0, 0.0, 0, 0]), row, strict=True)]
    return found


def run_patch(task: Task, bench: Bench) -> Note:
    """Artefacts: "<life>" with the panorama and its painting, "<life>-<run>" with the lays of a run's frames."""
    life = Life(**task.args["life"])
    maps, grid = LabelMaps(bench, life.begin), Grid.of(bench.size)
    with bench.clock("join"):
        lays = joined(life, bench)
    with bench.clock("relax"):
        unsettled = dict(lays)
        relaxed = settle(lays, life, maps, bench.params)
    bench.progress(0.3)
    room = Room.around(lays, grid)
    with bench.clock("mean"):
        found = ages(lays, life, maps, room, grid, bench)
        panoramas = pictures(found)
    painter = painter_of(life, bench, grid)
    looks = []
    for number, picture in enumerate(panoramas):
        with bench.clock("paint"):
            painting = painter.picture(picture)
        looks.append((picture, painting))
        bench.save(f"{life.key}-age{number}", {"panorama": picture, "painting": painting})
        bench.progress(0.7 + 0.3 * (number + 1) / len(found))
    _save(life, lays, bench)
    keep_patch(bench, life.key, looks)
    _report(task, life, unsettled, lays, maps, relaxed, bench)
    return {
        "before": relaxed.before, "after": relaxed.after, "iterations": relaxed.iterations, "frames": len(lays),
        "origin": list(room.origin), "ages": [[age.start, age.stop] for age in found],
    }  # fmt: skip


def _report(
    task: Task, life: Life, before: dict[int, Lay], after: dict[int, Lay], maps: LabelMaps, relaxed: Relaxed,
    bench: Bench,
) -> None:  # fmt: skip
    """Energies, and maps of the frame furthest from the master."""
    index = max(after, key=lambda frame: (abs(frame - life.master), frame))
    sheet = sheet_of(before[index], maps.sure(index) == life.label, bench.params, 1)
    pairs = dict(zip(("before", "after", "iterations", "pairs"), task.args["pairs"], strict=True))
    report = {
        "label": life.label, "frames": [life.start, life.stop], "master": life.master, "pairs": pairs,
        "all": {"before": relaxed.before, "after": relaxed.after, "iterations": relaxed.iterations}, "map": index,
    }  # fmt: skip
    maps_of = [distortion(sheet, lays[index].positions()) for lays in (before, after)]
    keep_energy(bench, life.key, report, maps_of[0], maps_of[1])


def painter_of(life: Life, bench: Bench, grid: Grid) -> Painter:
    """Table 1 by the area of the region over all its frames; a patch may have a style of its own."""
    style = style_of(life.label, bench.params, styles_of(bench))
    return Painter.of(style, life.area * grid.ratio[0] * grid.ratio[1], bench.size[1], bench.params, bench.seed)


def joined(life: Life, bench: Bench) -> dict[int, Lay]:
    """Where the patch lies in every frame that has it: warps concatenated, outward from the master both ways."""
    hops = _Hops(life, bench)
    height, width = hops.shape
    whole = (0, 0, width, height)
    lays = {life.master: Lay(hops.master_rect, IDENTITY, _no_rest(hops.master_rect))}
    for order in (range(life.master + 1, life.stop), range(life.master - 1, life.start - 1, -1)):
        for index in order:
            hop = hops(index)
            if hop is not None and index + hop.gap in lays:
                lays[index] = _concatenated(hop, lays[index + hop.gap], whole)
    return dict(sorted(lays.items()))


@dataclass(frozen=True)
class _Hop:
    rect: tuple[int, int, int, int]
    gap: int
    matrix: Homography
    shift: NDArray[np.float32]


@dataclass
class _Hops:
    """The warps of one patch, read run by run."""

    life: Life
    bench: Bench
    held: dict[int, dict[str, NDArray[Any]]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        labels = LabelMaps(self.bench, self.life.begin).sure(self.life.master)
        self.shape: tuple[int, int] = labels.shape
        self.master_rect = rect_of(labels == self.life.label, MARGIN)

    def __call__(self, index: int) -> _Hop | None:
        start = run_of(index, self.life.begin)
        if start not in self.held:
            self.held = {start: self.bench.load("register", run_key(start))}
        name, kept = f"{self.life.key}-{index}", self.held[start]
        if f"{name}-at" not in kept:
            return None
        left, top, right, bottom, gap = (int(value) for value in kept[f"{name}-at"])
        return _Hop((left, top, right, bottom), gap, kept[f"{name}-m"], kept[f"{name}-d"].astype(np.float32))


def _no_rest(rect: tuple[int, int, int, int]) -> NDArray[np.float16]:
    return np.zeros((rect[3] - rect[1], rect[2] - rect[0], 2), np.float16)


def _concatenated(hop: _Hop, before: Lay, whole: tuple[int, int, int, int]) -> Lay:
    """The frame's lay from that of the frame it hops to, in floating point throughout."""
    here = Lay(hop.rect, IDENTITY, hop.shift).positions()
    places = before.at(here)
    matrix = before.matrix @ hop.matrix
    matrix = matrix / matrix[2, 2]
    if not _sane(matrix, whole):
        matrix = before.matrix
    flat = Lay(hop.rect, matrix, np.zeros_like(hop.shift)).positions()
    return Lay(hop.rect, matrix, (places - flat).astype(np.float16))


def _sane(matrix: Homography, whole: tuple[int, int, int, int]) -> bool:
    """Whether the homography neither folds nor blows up the frame."""
    corners = np.array([[x, y, 1.0] for x in (whole[0], whole[2]) for y in (whole[1], whole[3])])
    depth = corners @ matrix[2]
    size = abs(np.linalg.det(matrix[:2, :2]))
    return bool(np.isfinite(matrix).all() and depth.min() > 0.3 and depth.max() < 3 and 0.05 < size < 20)


def settle(lays: dict[int, Lay], life: Life, maps: LabelMaps, params: PatchesParams) -> Relaxed:
    """Relax all frames on one grid, and change the lays, in place."""
    sheets = []
    for index in evenly(list(lays), MOST_SHEETS):
        lay = lays[index]
        labels = maps.sure(index)
        sheets.append(sheet_of(lay, labels == life.label, params, STRIDE))
    relaxed = relax(sheets, CELL)
    for index, lay in lays.items():
        places = lay.positions()
        rest = lay.rest + (relaxed.moved(places) - places)
        lays[index] = Lay(lay.rect, lay.matrix, rest.astype(np.float16))
    return relaxed


def sheet_of(lay: Lay, inside: Mask, params: PatchesParams, stride: int) -> Sheet:
    """Every `stride`-th pixel of a frame of the patch, on springs to where it lies; `inside` is of the whole frame."""
    left, top, right, bottom = lay.rect
    mask = np.ascontiguousarray(inside[top:bottom:stride, left:right:stride])
    scale = float(np.sqrt(abs(np.linalg.det(lay.matrix[:2, :2]))))
    targets = np.ascontiguousarray(lay.positions()[::stride, ::stride])
    return Sheet(targets, mask, np.full(mask.shape, params.stiffness, np.float32), scale * stride)


def evenly(items: list[int], most: int) -> list[int]:
    """At most so many of the items, evenly chosen, the ends among them."""
    if len(items) <= most:
        return items
    return [items[place] for place in np.linspace(0, len(items) - 1, most).round().astype(int).tolist()]


@dataclass(frozen=True)
class Room:
    """The panorama's rectangle: (x, y) of its first pixel and its (width, height), px."""

    origin: tuple[int, int]
    size: tuple[int, int]

    @classmethod
    def around(cls, lays: dict[int, Lay], grid: Grid) -> Room:
        """As large as all frames need, at most LARGEST times a frame's area."""
        ends = []
        for lay in lays.values():
            places = lay.positions()[::4, ::4].reshape(-1, 2)
            ends.append((places.min(axis=0), places.max(axis=0)))
        low = np.min([a for a, _ in ends], axis=0) * grid.ratio - 4
        high = np.max([b for _, b in ends], axis=0) * grid.ratio + 4 + 4 * grid.scale
        most = np.array([grid.width, grid.height]) * np.sqrt(LARGEST)
        middle = np.array([grid.width, grid.height]) / 2
        low, high = np.maximum(low, middle - most / 2), np.minimum(high, middle + most / 2)
        x, y = (int(np.floor(value)) for value in low)
        return cls((x, y), (max(int(np.ceil(high[0])) - x, 16), max(int(np.ceil(high[1])) - y, 16)))


@dataclass
class Age:
    """Frames [start, stop) of a life in which the patch looks alike, and their sums of colour."""

    start: int
    stop: int
    total: NDArray[np.float32]

    @property
    def known(self) -> Plane:
        return self.total[..., 3]


def ages(
    lays: dict[int, Lay], life: Life, maps: LabelMaps, room: Room, grid: Grid, bench: Bench
) -> list[Age]:  # fmt: skip
    """The patch's colours, summed over every frame that has the pixel.

    Departure: the paper has one mean for the life of a patch; of a face that turns or speaks that is no face. Where the
    mean of the next AGE frames is another picture, a new age begins: painted by the same strokes at the same places, in
    its own colours. What does not change has one age.
    """
    found: list[Age] = []
    now = Age(life.start, life.start, _empty(room))
    for index, frame in enumerate(bench.frames("video", life.start, life.stop), start=life.start):
        if (lay := lays.get(index)) is not None:
            add(now.total, frame, lay, maps.sure(index) == life.label, room, grid)
        now.stop = index + 1
        if now.stop - now.start >= AGE or now.stop == life.stop:
            _append(found, now, grid, bench.params)
            now = Age(now.stop, now.stop, _empty(room))
        bench.progress(0.3 + 0.4 * (index - life.start) / (life.stop - life.start))
    return found


def _empty(room: Room) -> NDArray[np.float32]:
    return np.zeros((room.size[1], room.size[0], 4), np.float32)


def add(
    total: NDArray[np.float32], frame: Frame, lay: Lay, inside: Mask, room: Room, grid: Grid
) -> None:  # fmt: skip
    """Add a frame's pixels of the patch to the sums, in place; `inside` is its cluster, bool, at the working size."""
    rect, x, y = full_map(lay, grid.ratio, (grid.width, grid.height), room.origin)
    weights = presence(inside, grid)[rect[1] : rect[3], rect[0] : rect[2]]
    weights = np.ascontiguousarray(np.maximum(weights, np.float32(OUTSIDE)))
    gather(total, np.ascontiguousarray(frame[rect[1] : rect[3], rect[0] : rect[2]]), weights, x, y)


def _append(found: list[Age], now: Age, grid: Grid, params: PatchesParams) -> None:
    """Join the age before if that looks alike, else begin anew."""
    if found and not differs(found[-1].total, now.total, grid, params):
        found[-1].total += now.total
        found[-1].stop = now.stop
    else:
        found.append(now)


def differs(before: NDArray[np.float32], after: NDArray[np.float32], grid: Grid, params: PatchesParams) -> bool:
    """Whether two sums of colour are of different pictures: by more than half the misfit on CHANGED of the pixels."""
    both = (before[..., 3] > 0.5) & (after[..., 3] > 0.5)
    if not both.any():
        return bool(after[..., 3].max(initial=0) > 0.5)
    means = [total[..., :3] / np.maximum(total[..., 3:], np.float32(1e-6)) for total in (before, after)]
    apart = cv2.GaussianBlur(np.where(both[..., None], means[1] - means[0], 0), (0, 0), fine_px(grid))
    return float((norm(apart) > params.misfit / 2)[both].mean()) > CHANGED


def fine_px(grid: Grid) -> float:
    """Sigma of the Gaussian at which a patch is compared with a frame, px: of the size of a fine stroke."""
    return max(2.0 * grid.height / PAPER_HEIGHT, 1.0)


def pictures(found: list[Age]) -> list[Frame]:
    """The mean of each age; what an age has not seen is from the others."""
    every = np.sum([age.total for age in found], axis=0) * np.float32(1e-3)
    return [mean(age.total + every)[0] for age in found]


def presence(inside: Mask, grid: Grid) -> Plane:
    """How far each pixel of the frame is in a cluster, 0..1, smooth at its border: float32 (h, w), px.

    Over all labels, 0 included, it sums to 1.
    """
    soft = cv2.GaussianBlur(inside.astype(np.float32), (0, 0), 0.7)
    return np.asarray(grid.enlarge(soft), np.float32)


def _save(life: Life, lays: dict[int, Lay], bench: Bench) -> None:
    """Keep the lays by run, as the last step needs them."""
    by_run: dict[int, dict[str, NDArray[Any]]] = {
        run_of(index, life.begin): {} for index in range(life.start, life.stop)
    }
    for index, lay in lays.items():
        kept = by_run[run_of(index, life.begin)]
        kept[f"{index}-at"], kept[f"{index}-m"], kept[f"{index}-d"] = np.array(lay.rect), lay.matrix, lay.rest
    for start, arrays in by_run.items():
        bench.save(f"{life.key}-{run_key(start)}", arrays)
