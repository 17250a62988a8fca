"""Step "register": warps of each patch between neighbouring frames (zhang2011patches, section 5).

Each frame of a patch except its master frame is warped to the neighbouring frame on the side of the master. The warp
follows the optical flow where it is reliable and a homography elsewhere, and is relaxed on springs. Runs are processed
in parallel; the next step concatenates the warps.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Flow, Labels, Mask, Plane
from pipeline.methods.base import PlanContext, Task, TaskContext, TaskResult
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
"""A patch extends this far beyond its cluster, working px. Neighbouring patches overlap, which avoids seams."""
LOOSE = 0.1
"""Spring stiffness where the flow is unreliable, relative to the stiffness elsewhere."""


def plan_register(context: PlanContext[PatchesParams]) -> list[Task]:
    if context.params.temporal != "on":
        return []
    every = lives(context)
    tasks = []
    for start, stop, begin, end in runs(context):
        here = [life.args() for life in every if life.begin == begin and life.start < stop and life.stop > start]
        args = {"start": start, "stop": stop, "begin": begin, "end": end, "lives": here}
        tasks.append(Task(run_key(start), args, weight=0.3 * (stop - start)))
    return tasks


def run_register(task: Task, context: TaskContext[PatchesParams]) -> TaskResult:
    """Compute the warps of a run and save them as artefacts "<life>-<run>", see `save_hops`.

    The result holds for each patch the summed energy before and after relaxation, iterations and number of warps.
    """
    start, stop, begin = (task.args[name] for name in ("start", "stop", "begin"))
    kept: dict[str, dict[int, Hop]] = {row["key"]: {} for row in task.args["lives"]}
    energies: dict[str, list[float]] = {}
    views = Views(Links(context, begin, RUN), LabelMaps(context, begin), context.params)
    for index in range(start, stop):
        for life in (Life(**row) for row in task.args["lives"]):
            if not life.start <= index < life.stop:
                continue
            with context.clock("register"):
                hop = views.hop(life, index)
            if hop is None:
                continue
            kept[life.key][index] = hop
            if index != life.master:
                row = energies.setdefault(life.key, [0.0, 0.0, 0, 0])
                energies[life.key] = [row[0] + hop.before, row[1] + hop.after, row[2] + hop.iterations, row[3] + 1]
        context.progress((index + 1 - start) / (stop - start))
    for key, hops in kept.items():
        save_hops(context, f"{key}-{task.key}", hops)
    return {"energies": energies}


@dataclass(frozen=True)
class Hop:
    """Warp of a patch from one frame to a frame nearer to its master: p -> p + shift(p).

    Attributes:
        rect: rectangle of the frame that contains the patch, working px.
        gap: signed frame distance; the target is frame index + gap. 0 in the master frame.
        matrix: best-fitting homography.
        shift: float16 (h, w, 2), displacement, working px.
        before, after: distortion energy before and after relaxation, working px^2.
        iterations: number of relaxation steps.
    """

    rect: Rect
    gap: int
    matrix: Homography
    shift: NDArray[np.float16]
    before: float = 0.0
    after: float = 0.0
    iterations: int = 0


def save_hops(context: TaskContext[PatchesParams], name: str, hops: Mapping[int, Hop]) -> None:
    """Save the warps of one patch, by frame. They are packed into three arrays, because each array adds overhead."""
    rows = [[index, hop.gap, *hop.rect] for index, hop in hops.items()]
    context.save(name, {
        "at": np.array(rows, np.int32).reshape(-1, 6),
        "matrix": np.array([hop.matrix for hop in hops.values()]).reshape(-1, 3, 3),
        "shift": np.concatenate([np.zeros((0, 2), np.float16), *(hop.shift.reshape(-1, 2) for hop in hops.values())]),
    })  # fmt: skip


def load_hops(context: TaskContext[PatchesParams], name: str, step: str = "register") -> dict[int, Hop]:
    """Load the warps of one patch that `save_hops` has saved, by frame."""
    kept, hops, used = context.load(step, name), {}, 0
    for row, matrix in zip(kept["at"].tolist(), kept["matrix"], strict=True):
        index, gap, left, top, right, bottom = row
        size = (bottom - top) * (right - left)
        shift = kept["shift"][used : used + size].reshape(bottom - top, right - left, 2)
        hops[index], used = Hop((left, top, right, bottom), gap, matrix, shift), used + size
    return hops


@dataclass
class Views:
    """Computes warps of patches from the links and label maps of a shot."""

    links: Links
    maps: LabelMaps
    params: PatchesParams
    _texture: tuple[int, Mask] | None = None

    def hop(self, life: Life, index: int, *, most: int = MOST_ITERATIONS) -> Hop | None:
        """Warp of one frame of a patch; None if the patch is not in the frame.

        Args:
            most: largest number of relaxation steps.
        """
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
        """Region of the patch in a frame; None if the patch is not in the frame."""
        mask = self.maps.sure(index) == life.label
        if not mask.any():
            return None
        rect = rect_of(mask, MARGIN)
        return Here(rect, mask[rect[1] : rect[3], rect[0] : rect[2]], life)

    def sheet(self, here: Here, index: int) -> tuple[int, Homography, Sheet]:
        """Signed gap to the target frame, the homography that fits the flow best, and the spring system."""
        gap, flow, sure, matrix = (self._backward if index > here.life.master else self._forward)(here, index)
        return gap, matrix, _sheet(flow, sure, matrix, here.rect, here.mask, self.params)

    def _seen(self, here: Here, index: int) -> Mask:
        """Textured pixels of the patch: bool (h, w)."""
        if self._texture is None or self._texture[0] != index:
            self._texture = index, textured(self.links.small(index))
        return np.asarray(here.mask & here.cut(self._texture[1]))

    def _backward(self, here: Here, index: int) -> Found:
        """Link to the nearest earlier frame of the window that contains the patch."""
        for gap in range(1, self.params.window):
            before = self.maps(index - gap) if index - gap >= here.life.start else None
            pair = self.links.back(index, gap)
            if before is not None and pair is not None and (before == here.life.label).any():
                return -gap, *here.direct(*pair, self._seen(here, index), before, self.params.reliable)
        return -1, *here.nothing()

    def _forward(self, here: Here, index: int) -> Found:
        """Link to the nearest later frame of the window that contains the patch.

        For gaps above 1 only the flow of the later frame is stored. The homography is fitted to its inverted links.
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
    """Bounding box of a mask, extended by `margin` px on each side and clipped to the picture."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return (
        max(int(columns[0]) - margin, 0), max(int(rows[0]) - margin, 0),
        min(int(columns[-1]) + margin + 1, mask.shape[1]), min(int(rows[-1]) + margin + 1, mask.shape[0]),
    )  # fmt: skip


Found = tuple[int, Flow, Plane, Homography]


@dataclass(frozen=True)
class Here:
    """Region of a patch in a frame.

    Attributes:
        rect: rectangle of the frame, working px.
        mask: bool (h, w), pixels of the patch within the rectangle.
        life: the patch.
    """

    rect: Rect
    mask: Mask
    life: Life

    def cut(self, plane: NDArray[Any]) -> NDArray[Any]:
        """Crop a plane of the frame to the rectangle."""
        return plane[self.rect[1] : self.rect[3], self.rect[0] : self.rect[2]]

    def direct(
        self, flow: Flow, reliable: Plane, seen: Mask, other: Labels, least: float
    ) -> tuple[Flow, Plane, Homography]:
        """Flow to the target frame, its reliable pixels (1, else 0), and the fitted homography.

        A flow vector is used if it is reliable, starts on texture, and leads from the patch to the same patch.

        Args:
            flow, reliable: float32, of the whole frame.
            seen: bool (h, w), textured pixels of the patch.
            other: label map of the target frame.
            least: lowest accepted reliability.
        """
        flow, reliable = self.cut(flow), self.cut(reliable)
        arrives = cv2.dilate((other == self.life.label).astype(np.uint8), np.ones((3, 3), np.uint8)).astype(np.int32)
        sure = seen & (reliable >= least) & (carry_labels(arrives, flow, self.rect[:2]) > 0)
        here = lattice(seen.shape, self.rect[:2])[sure]
        return flow, sure.astype(np.float32), fit(here, here + flow[sure], weights=reliable[sure])

    def turned(self, flow: Flow, reliable: Plane, there: Mask, least: float) -> tuple[Flow, Plane, Homography]:
        """No flow, and the homography fitted to the inverted flow from the target frame to this one."""
        sure = there & (reliable >= least)
        place = lattice(there.shape)[sure]
        matrix = fit(place + flow[sure], place, weights=reliable[sure])
        return *self.nothing()[:2], matrix

    def nothing(self) -> tuple[Flow, Plane, Homography]:
        """No reliable flow, and the identity."""
        return np.zeros((*self.mask.shape, 2), np.float32), np.zeros(self.mask.shape, np.float32), IDENTITY


def _sheet(flow: Flow, sure: Plane, matrix: Homography, rect: Rect, mask: Mask, params: PatchesParams) -> Sheet:
    """Spring system of the patch's pixels: targets from the flow where it is reliable, else from the homography.

    Departure: deviations from the homography below `params.rigidity` are treated as flow noise and removed, so that
    strokes on rigid objects stay rigid. With 0, 0.15 and 0.3 px, the mean change per frame of a painted wall under a
    known pan is 0.52, 0.48 and 0.44 gray levels, that of a static room filmed by webcam 0.79, 0.73 and 0.68. An
    independent warping error, computed with flow as noisy as ours, is 0.85, 0.90 and 0.97 (foreman). The default 0.15
    is a compromise.
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
