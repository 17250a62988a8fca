"""Step "register": how each patch's pixels move from frame to frame, with little distortion (section 5).

For every frame of a patch but its master, the warp to the frame next to it on the way to the master: flow where it can
be trusted, a homography for the rest, relaxed on springs. Runs are parallel; the warps are joined in the next step.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Flow, Labels, Mask, Plane
from pipeline.methods.base import Bench, Brief, Note, Task
from pipeline.methods.patches.clusters import LabelMaps
from pipeline.methods.patches.links import Links, norm, textured
from pipeline.methods.patches.lives import Life, lives
from pipeline.methods.patches.params import PatchesParams
from pipeline.methods.patches.scan import RUN, run_key, runs
from pipeline.methods.patches.tracking import carry_labels
from pipeline.warp.homography import IDENTITY, Homography, apply, fit, lattice
from pipeline.warp.panorama import Rect
from pipeline.warp.springs import MOST_ITERATIONS, Sheet, relax

MARGIN = 5
"""A patch is painted this much beyond its cluster, working px: neighbours overlap, so that no seam is seen."""
LOOSE = 0.1
"""Stiffness where there is no flow to trust, as a part of that where there is."""


def plan_register(brief: Brief) -> list[Task]:
    if brief.params.temporal != "on":
        return []
    every = lives(brief)
    tasks = []
    for start, stop, begin, end in runs(brief):
        here = [life.args() for life in every if life.begin == begin and life.start < stop and life.stop > start]
        args = {"start": start, "stop": stop, "begin": begin, "end": end, "lives": here}
        tasks.append(Task(run_key(start), args, weight=0.3 * (stop - start)))
    return tasks


def run_register(task: Task, bench: Bench) -> Note:
    """Artefacts "<life>-<run>", see `save_hops`; the note tells energies before and after by patch, and iterations."""
    start, stop, begin = (task.args[name] for name in ("start", "stop", "begin"))
    kept: dict[str, dict[int, Hop]] = {row["key"]: {} for row in task.args["lives"]}
    energies: dict[str, list[float]] = {}
    views = Views(Links(bench, begin, RUN), LabelMaps(bench, begin), bench.params)
    for index in range(start, stop):
        for life in (Life(**row) for row in task.args["lives"]):
            if not life.start <= index < life.stop:
                continue
            with bench.clock("register"):
                hop = views.hop(life, index)
            if hop is None:
                continue
            kept[life.key][index] = hop
            if index != life.master:
                row = energies.setdefault(life.key, [0.0, 0.0, 0, 0])
                energies[life.key] = [row[0] + hop.before, row[1] + hop.after, row[2] + hop.iterations, row[3] + 1]
        bench.progress((index + 1 - start) / (stop - start))
    for key, hops in kept.items():
        save_hops(bench, f"{key}-{task.key}", hops)
    return {"energies": energies}


@dataclass(frozen=True)
class Hop:
    """The warp of a patch from one frame to one `gap` nearer its master: p goes to p + shift(p).

    Attributes:
        rect: of the frame, working px.
        gap: signed: to frame index + gap; 0 in the master frame.
        matrix: the homography that explains it best.
        shift: float16 (h, w, 2), working px.
        before, after: distortion energy, working px^2; iterations: of the relaxation.
    """

    rect: Rect
    gap: int
    matrix: Homography
    shift: NDArray[np.float16]
    before: float = 0.0
    after: float = 0.0
    iterations: int = 0


def save_hops(bench: Bench, name: str, hops: Mapping[int, Hop]) -> None:
    """Keep the hops of one patch by frame: three arrays, since every one in an artefact takes its time."""
    rows = [[index, hop.gap, *hop.rect] for index, hop in hops.items()]
    bench.save(name, {
        "at": np.array(rows, np.int32).reshape(-1, 6),
        "matrix": np.array([hop.matrix for hop in hops.values()]).reshape(-1, 3, 3),
        "shift": np.concatenate([np.zeros((0, 2), np.float16), *(hop.shift.reshape(-1, 2) for hop in hops.values())]),
    })  # fmt: skip


def load_hops(bench: Bench, name: str, step: str = "register") -> dict[int, Hop]:
    """What `save_hops` has kept."""
    kept, hops, used = bench.load(step, name), {}, 0
    for row, matrix in zip(kept["at"].tolist(), kept["matrix"], strict=True):
        index, gap, left, top, right, bottom = row
        size = (bottom - top) * (right - left)
        shift = kept["shift"][used : used + size].reshape(bottom - top, right - left, 2)
        hops[index], used = Hop((left, top, right, bottom), gap, matrix, shift), used + size
    return hops


@dataclass
class Views:
    """Frames as a patch is registered in them."""

    links: Links
    maps: LabelMaps
    params: PatchesParams
    _texture: tuple[int, Mask] | None = None

    def hop(self, life: Life, index: int, *, most: int = MOST_ITERATIONS) -> Hop | None:
        """The warp of one frame of a patch, after at most so many steps; None where the frame does not have it."""
        here = self.here(life, index)
        if here is None:
            return None
        if index == life.master:
            return Hop(here.rect, 0, IDENTITY, np.zeros((*here.mask.shape, 2), np.float16))
        gap, matrix, sheet = self.sheet(here, index)
        relaxed = relax([sheet], most=most)
        shift = relaxed.moved(sheet.targets) - lattice(here.mask.shape, here.rect[:2])
        return Hop(here.rect, gap, matrix, shift.astype(np.float16), relaxed.before, relaxed.after, relaxed.iterations)

    def here(self, life: Life, index: int) -> Here | None:
        """Where a frame has the patch; None where it does not."""
        mask = self.maps.sure(index) == life.label
        if not mask.any():
            return None
        rect = rect_of(mask, MARGIN)
        return Here(rect, mask[rect[1] : rect[3], rect[0] : rect[2]], life)

    def sheet(self, here: Here, index: int) -> tuple[int, Homography, Sheet]:
        """Gap to the frame nearer the master, the motion that explains the flow there best, and springs to the flow."""
        gap, flow, sure, matrix = (self._backward if index > here.life.master else self._forward)(here, index)
        return gap, matrix, _sheet(flow, sure, matrix, here.rect, here.mask, self.params)

    def _seen(self, here: Here, index: int) -> Mask:
        """Where the patch has texture."""
        if self._texture is None or self._texture[0] != index:
            self._texture = index, textured(self.links.small(index))
        return np.asarray(here.mask & here.cut(self._texture[1]))

    def _backward(self, here: Here, index: int) -> Found:
        """To the nearest earlier frame of the window that has the patch."""
        for gap in range(1, self.params.window):
            before = self.maps(index - gap) if index - gap >= here.life.start else None
            pair = self.links.back(index, gap)
            if before is not None and pair is not None and (before == here.life.label).any():
                return -gap, *here.direct(*pair, self._seen(here, index), before, self.params.reliable)
        return -1, *here.nothing()

    def _forward(self, here: Here, index: int) -> Found:
        """To the nearest later frame of the window that has the patch.

        Over a gap only the later frame's flow is kept: its links, turned round, give the homography.
        """
        for gap in range(1, self.params.window):
            if index + gap >= min(here.life.stop, here.life.end):
                break
            after = self.maps(index + gap)
            if after is None or not (after == here.life.label).any():
                continue
            if gap == 1 and (pair := self.links.ahead(index)) is not None:
                return 1, *here.direct(*pair, self._seen(here, index), after, self.params.reliable)
            if (pair := self.links.back(index + gap, gap)) is not None:
                return gap, *here.turned(*pair, after == here.life.label, self.params.reliable)
        return 1, *here.nothing()


def rect_of(mask: Mask, margin: int) -> Rect:
    """The box of a mask, `margin` wider, within the picture."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return (
        max(int(columns[0]) - margin, 0), max(int(rows[0]) - margin, 0),
        min(int(columns[-1]) + margin + 1, mask.shape[1]), min(int(rows[-1]) + margin + 1, mask.shape[0]),
    )  # fmt: skip


Found = tuple[int, Flow, Plane, Homography]


@dataclass(frozen=True)
class Here:
    """The rectangle of a frame that has the patch: `mask`, bool (h, w), says where."""

    rect: Rect
    mask: Mask
    life: Life

    def cut(self, plane: NDArray[Any]) -> NDArray[Any]:
        """The rectangle's part of a plane of the frame."""
        return plane[self.rect[1] : self.rect[3], self.rect[0] : self.rect[2]]

    def direct(
        self, flow: Flow, reliable: Plane, seen: Mask, other: Labels, least: float
    ) -> tuple[Flow, Plane, Homography]:
        """Flow and where it is to be trusted: reliable, on texture, from the patch to the patch."""
        flow, reliable = self.cut(flow), self.cut(reliable)
        arrives = cv2.dilate((other == self.life.label).astype(np.uint8), np.ones((3, 3), np.uint8)).astype(np.int32)
        sure = seen & (reliable >= least) & (carry_labels(arrives, flow, self.rect[:2]) > 0)
        here = lattice(seen.shape, self.rect[:2])[sure]
        return flow, sure.astype(np.float32), fit(here, here + flow[sure], weights=reliable[sure])

    def turned(self, flow: Flow, reliable: Plane, there: Mask, least: float) -> tuple[Flow, Plane, Homography]:
        """No flow of its own, and the homography of the flow that leads here."""
        sure = there & (reliable >= least)
        place = lattice(there.shape)[sure]
        matrix = fit(place + flow[sure], place, weights=reliable[sure])
        return *self.nothing()[:2], matrix

    def nothing(self) -> tuple[Flow, Plane, Homography]:
        """No flow to trust, and no motion."""
        return np.zeros((*self.mask.shape, 2), np.float32), np.zeros(self.mask.shape, np.float32), IDENTITY


def _sheet(flow: Flow, sure: Plane, matrix: Homography, rect: Rect, mask: Mask, params: PatchesParams) -> Sheet:
    """The patch's pixels on springs: at the flow's position where that is sure, at the homography's elsewhere.

    Departure: what differs from the homography by less than `params.rigidity` is taken for noise of the flow, and put
    where the homography says; rigid things keep rigid strokes. At 0, 0.15 and 0.3 px a painted wall changes by 0.52,
    0.48 and 0.44 gray levels a frame along a pan that is known, and a webcam's still room by 0.79, 0.73 and 0.68; yet
    an outside measure, whose flow has the same noise as ours, gives 0.85, 0.90 and 0.97 (foreman). 0.15 is between.
    """
    here = lattice(mask.shape, rect[:2])
    plane = apply(matrix, here).astype(np.float32)
    off = (here + flow - plane) * sure[..., None]
    share = np.maximum(cv2.GaussianBlur(sure, (0, 0), 1.5), np.float32(1e-3))
    smooth = cv2.GaussianBlur(off, (0, 0), 1.5) / share[..., None]
    far = norm(smooth)
    if params.rigidity > 0:
        keep = np.clip(far / np.float32(params.rigidity) - 1, 0, 1)
        off = off * (keep * keep * (3 - 2 * keep))[..., None]
    stiffness = np.where(sure > 0, params.stiffness, params.stiffness * LOOSE).astype(np.float32)
    rest = float(np.sqrt(abs(np.linalg.det(matrix[:2, :2]))))
    return Sheet((plane + off).astype(np.float32), mask, stiffness, rest)
