"""Step "register": how each patch's pixels move from frame to frame, with little distortion (section 5).

For every frame of a patch but its master, the warp to the frame next to it on the way to the master: flow where it can
be trusted, a homography for the rest, relaxed on springs. Runs are parallel; the warps are joined in the next step.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Flow, Labels, Mask, Plane
from pipeline.methods.base import Bench, Brief, Note, Task
from pipeline.methods.patches.clusters import LabelMaps
from pipeline.methods.patches.links import Links, textured
from pipeline.methods.patches.lives import Life, lives
from pipeline.methods.patches.params import PatchesParams
from pipeline.methods.patches.scan import RUN, run_key, runs
from pipeline.methods.patches.tracking import carry_labels
from pipeline.warp.homography import IDENTITY, Homography, apply, fit, lattice
from pipeline.warp.panorama import Rect
from pipeline.warp.springs import Sheet, relax

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
    """Steps "<life>-<frame>": see `Hop`. The note tells each patch's energy before and after, and its iterations."""
    params: PatchesParams = bench.params
    start, stop, begin, end = (task.args[name] for name in ("start", "stop", "begin", "end"))
    links, maps = Links(bench, begin, RUN), LabelMaps(bench, begin)
    kept: dict[str, NDArray[Any]] = {}
    energies: dict[str, list[float]] = {}
    for index in range(start, stop):
        for life in (Life(**row) for row in task.args["lives"]):
            if not life.start <= index < life.stop or index == life.master:
                continue
            with bench.clock("register"):
                hop = hop_of(life, index, links, maps, end, params)
            if hop is None:
                continue
            kept |= hop.arrays(f"{life.key}-{index}")
            row = energies.setdefault(life.key, [0.0, 0.0, 0, 0])
            energies[life.key] = [row[0] + hop.before, row[1] + hop.after, row[2] + hop.iterations, row[3] + 1]
        bench.progress((index + 1 - start) / (stop - start))
    bench.save(task.key, kept)
    return {"energies": energies}


@dataclass(frozen=True)
class Hop:
    """The warp of a patch from one frame to one `gap` nearer its master: p goes to p + shift(p).

    Attributes:
        rect: of the frame, working px.
        gap: signed: to frame index + gap.
        matrix: the homography that explains it best.
        shift: float16 (h, w, 2), working px.
        before, after: distortion energy, working px^2; iterations: of the relaxation.
    """

    rect: Rect
    gap: int
    matrix: Homography
    shift: NDArray[np.float16]
    before: float
    after: float
    iterations: int

    def arrays(self, name: str) -> dict[str, NDArray[Any]]:
        return {f"{name}-at": np.array([*self.rect, self.gap]), f"{name}-m": self.matrix, f"{name}-d": self.shift}


def hop_of(life: Life, index: int, links: Links, maps: LabelMaps, end: int, params: PatchesParams) -> Hop | None:
    """The warp of one frame of a patch; None where the frame does not have it."""
    labels = maps(index)
    assert labels is not None
    mask = labels == life.label
    if not mask.any():
        return None
    rect = rect_of(mask, MARGIN)
    box = slice(rect[1], rect[3]), slice(rect[0], rect[2])
    found = _backward if index > life.master else _forward
    gap, flow, sure, matrix = found(life, index, links, maps, mask, params)
    sheet = _sheet(flow[box], sure[box], matrix, rect, mask[box], params)
    relaxed = relax([sheet])
    laid = relaxed.moved(sheet.targets)
    shift = laid - lattice(laid.shape[:2], rect[:2])
    return Hop(rect, gap, matrix, shift.astype(np.float16), relaxed.before, relaxed.after, relaxed.iterations)


def rect_of(mask: Mask, margin: int) -> Rect:
    """The box of a mask, `margin` wider, within the picture."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return (
        max(int(columns[0]) - margin, 0), max(int(rows[0]) - margin, 0),
        min(int(columns[-1]) + margin + 1, mask.shape[1]), min(int(rows[-1]) + margin + 1, mask.shape[0]),
    )  # fmt: skip


Found = tuple[int, Flow, Plane, Homography]


def _backward(life: Life, index: int, links: Links, maps: LabelMaps, mask: Mask, params: PatchesParams) -> Found:
    """To the nearest earlier frame of the window that has the patch."""
    seen = mask & textured(links.small(index))
    for gap in range(1, params.window):
        before = maps(index - gap) if index - gap >= life.start else None
        pair = links.back(index, gap)
        if before is not None and pair is not None and (before == life.label).any():
            return -gap, *_direct(*pair, seen, before, life.label, params)
    return -1, *_nothing(mask)


def _forward(life: Life, index: int, links: Links, maps: LabelMaps, mask: Mask, params: PatchesParams) -> Found:
    """To the nearest later frame of the window that has the patch.

    Over a gap only the later frame's flow is kept: its links, turned round, give the homography.
    """
    seen = mask & textured(links.small(index))
    for gap in range(1, params.window):
        if index + gap >= min(life.stop, life.end):
            break
        after = maps(index + gap)
        if after is None or not (after == life.label).any():
            continue
        if gap == 1 and (pair := links.ahead(index)) is not None:
            return 1, *_direct(*pair, seen, after, life.label, params)
        if (pair := links.back(index + gap, gap)) is not None:
            return gap, *_turned(*pair, mask, after == life.label, params)
    return 1, *_nothing(mask)


def _direct(
    flow: Flow, reliable: Plane, mask: Mask, other: Labels, label: int, params: PatchesParams
) -> tuple[Flow, Plane, Homography]:
    """Flow and where it is to be trusted: reliable, on texture, from the patch to the patch."""
    arrives = cv2.dilate((other == label).astype(np.uint8), np.ones((3, 3), np.uint8)).astype(np.int32)
    sure = mask & (reliable >= params.reliable) & (carry_labels(arrives, flow) > 0)
    here = lattice(mask.shape)
    matrix = fit(here[sure], (here + flow)[sure], weights=reliable[sure])
    return flow, sure.astype(np.float32), matrix


def _turned(
    flow: Flow, reliable: Plane, mask: Mask, there: Mask, params: PatchesParams
) -> tuple[Flow, Plane, Homography]:
    sure = there & (reliable >= params.reliable)
    here = lattice(mask.shape)
    matrix = fit((here + flow)[sure], here[sure], weights=reliable[sure])
    return np.zeros_like(flow), np.zeros(mask.shape, np.float32), matrix


def _nothing(mask: Mask) -> tuple[Flow, Plane, Homography]:
    return np.zeros((*mask.shape, 2), np.float32), np.zeros(mask.shape, np.float32), IDENTITY


def _sheet(flow: Flow, sure: Plane, matrix: Homography, rect: Rect, mask: Mask, params: PatchesParams) -> Sheet:
    """The patch's pixels on springs: at the flow's position where that is sure, at the homography's elsewhere.

    Departure: what differs from the homography by less than `params.rigidity` is taken for noise of the flow, and put
    where the homography says; rigid things keep rigid strokes.
    """
    here = lattice(mask.shape, rect[:2])
    plane = apply(matrix, here).astype(np.float32)
    off = (here + flow - plane) * sure[..., None]
    share = np.maximum(cv2.GaussianBlur(sure, (0, 0), 1.5), np.float32(1e-3))
    smooth = cv2.GaussianBlur(off, (0, 0), 1.5) / share[..., None]
    far = np.linalg.norm(smooth, axis=-1)
    if params.rigidity > 0:
        keep = np.clip(far / np.float32(params.rigidity) - 1, 0, 1)
        off = off * (keep * keep * (3 - 2 * keep))[..., None]
    stiffness = np.where(sure > 0, params.stiffness, params.stiffness * LOOSE).astype(np.float32)
    rest = float(np.sqrt(abs(np.linalg.det(matrix[:2, :2]))))
    return Sheet((plane + off).astype(np.float32), mask, stiffness, rest)
