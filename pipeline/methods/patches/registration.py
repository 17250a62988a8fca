"""Step "register": warps of each patch between neighbouring frames (zhang2011patches, section 5).

Each frame of a patch except its master frame is warped to the neighbouring frame on the side of the master. The warp
follows the optical flow where it is reliable and a homography elsewhere, and is relaxed on springs. Runs are processed
in parallel; the next step concatenates the warps.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import AnyArray
from pipeline.frames import Flow, Labels, Mask, Plane
from pipeline.kernels.float16 import to_half
from pipeline.kernels.jit import kernel
from pipeline.methods.base import PlanContext, Task, TaskContext, TaskResult
from pipeline.methods.patches.clustering import LabelMaps
from pipeline.methods.patches.motion_clustering import warp_labels
from pipeline.methods.patches.params import PatchesParams
from pipeline.methods.patches.patch_track import PatchTrack, patch_tracks
from pipeline.methods.patches.scan import run_key, runs
from pipeline.methods.patches.window_flow import WindowFlow, textured
from pipeline.warp.homography import IDENTITY, Homography, fit, lattice
from pipeline.warp.panorama import Rect
from pipeline.warp.springs import MOST_ITERATIONS, Sheet, relax

MARGIN_PX = 5
"""A patch extends this far beyond its cluster, working px. Neighbouring patches overlap, which avoids seams."""
UNRELIABLE_STIFFNESS = 0.1
"""Spring stiffness where the flow is unreliable, relative to the stiffness elsewhere."""


def plan_register(context: PlanContext[PatchesParams]) -> list[Task]:
    """One task per run of frames; none without painting patches."""
    if context.params.temporal != "on":
        return []
    every = patch_tracks(context)
    tasks = []
    for start, stop, begin, end in runs(context):
        tracks = [
            _near(track, start, stop, context.params.window) for track in every
            if track.begin == begin and track.start < stop and track.stop > start
        ]  # fmt: skip
        args = {"start": start, "stop": stop, "begin": begin, "end": end, "tracks": tracks}
        tasks.append(Task(run_key(start), args, weight=0.26 * (stop - start)))
    return tasks


def _near(track: PatchTrack, start: int, stop: int, window: int) -> TaskResult:
    """The track as far as the registration of frames [start, stop) sees it: a run that a correction of other frames
    does not touch keeps its result."""
    return track.args("all-frames") | {
        "start": max(track.start, start - window), "stop": min(track.stop, stop + window), "area": 0
    }  # fmt: skip


def run_register(task: Task, context: TaskContext[PatchesParams]) -> TaskResult:
    """Compute the warps of a run and save them as artefacts "<patch>-<run>", see `save_warps`.

    The result holds for each patch the summed energy before and after relaxation, iterations and number of warps.
    """
    start, stop, begin = (task.args[name] for name in ("start", "stop", "begin"))
    tracks = [PatchTrack(**args) for args in task.args["tracks"]]
    warps: dict[str, dict[int, FrameWarp]] = {track.key: {} for track in tracks}
    energies: dict[str, list[float]] = {}
    registration = Registration(WindowFlow(context, begin), LabelMaps(context, begin), context.params)
    for index in range(start, stop):
        for track in tracks:
            if not track.start <= index < track.stop:
                continue
            with context.clock("register"):
                warp = registration.warp(track, index)
            if warp is None:
                continue
            warps[track.key][index] = warp
            if index != track.master:
                row = energies.setdefault(track.key, [0.0, 0.0, 0, 0])
                energies[track.key] = [
                    row[0] + warp.before, row[1] + warp.after, row[2] + warp.iterations, row[3] + 1
                ]  # fmt: skip
        context.progress((index + 1 - start) / (stop - start))
    for key, of_patch in warps.items():
        save_warps(context, f"{key}-{task.key}", of_patch)
    return {"energies": energies}


@dataclass(frozen=True)
class FrameWarp:
    """Warp of a patch from one frame to a frame nearer to its master: p -> p + displacement(p).

    Attributes:
        rect: rectangle of the frame that contains the patch, working px.
        gap: signed frame distance; the target is frame index + gap. 0 in the master frame.
        matrix: best-fitting homography.
        displacement: float16 (h, w, 2), working px.
        before, after: distortion energy before and after relaxation, working px^2.
        iterations: number of relaxation steps.
    """

    rect: Rect
    gap: int
    matrix: Homography
    displacement: NDArray[np.float16]
    before: float = 0.0
    after: float = 0.0
    iterations: int = 0


def save_warps(context: TaskContext[PatchesParams], name: str, warps: Mapping[int, FrameWarp]) -> None:
    """Save the warps of one patch, by frame. They are packed into three arrays, because each array adds overhead."""
    rows = [[index, warp.gap, *warp.rect] for index, warp in warps.items()]
    displacements = (warp.displacement.reshape(-1, 2) for warp in warps.values())
    context.save(name, {
        "at": np.array(rows, np.int32).reshape(-1, 6),
        "matrix": np.array([warp.matrix for warp in warps.values()]).reshape(-1, 3, 3),
        "shift": np.concatenate([np.zeros((0, 2), np.float16), *displacements]),
    })  # fmt: skip


def load_warps(context: TaskContext[PatchesParams], name: str, step: str = "register") -> dict[int, FrameWarp]:
    """Load the warps of one patch that `save_warps` has saved, by frame."""
    arrays, warps, used = context.load(step, name), {}, 0
    for row, matrix in zip(arrays["at"].tolist(), arrays["matrix"], strict=True):
        index, gap, left, top, right, bottom = row
        size = (bottom - top) * (right - left)
        displacement = arrays["shift"][used : used + size].reshape(bottom - top, right - left, 2)
        warps[index], used = FrameWarp((left, top, right, bottom), gap, matrix, displacement), used + size
    return warps


@dataclass
class Registration:
    """Computes warps of patches from the flow and the label maps of a shot."""

    flow: WindowFlow
    maps: LabelMaps
    params: PatchesParams
    _texture: tuple[int, Mask] | None = None

    def warp(self, track: PatchTrack, index: int, *, max_iterations: int = MOST_ITERATIONS) -> FrameWarp | None:
        """Warp of one frame of a patch; None if the patch is not in the frame.

        Args:
            max_iterations: largest number of relaxation steps; 0 = no relaxation.
        """
        region = self.region(track, index)
        if region is None:
            return None
        if index == track.master:
            return FrameWarp(region.rect, 0, IDENTITY, np.zeros((*region.mask.shape, 2), np.float16))
        gap, matrix, sheet = self.spring_system(region, index)
        relaxed = relax([sheet], most=max_iterations)
        displacement = to_half(relaxed.moved(sheet.targets) - lattice(region.mask.shape, region.rect[:2]))
        return FrameWarp(region.rect, gap, matrix, displacement, relaxed.before, relaxed.after, relaxed.iterations)

    def region(self, track: PatchTrack, index: int) -> PatchRegion | None:
        """Region of the patch in a frame; None if the patch is not in the frame."""
        mask = self.maps.require(index) == track.label
        if not mask.any():
            return None
        rect = bounding_rect(mask, MARGIN_PX)
        return PatchRegion(rect, mask[rect[1] : rect[3], rect[0] : rect[2]], track)

    def spring_system(self, region: PatchRegion, index: int) -> tuple[int, Homography, Sheet]:
        """Signed gap to the target frame, the homography that fits the flow best, and the spring system."""
        target = self._earlier if index > region.track.master else self._later
        gap, flow, reliable, matrix = target(region, index)
        return gap, matrix, _spring_system(flow, reliable, matrix, region.rect, region.mask, self.params)

    def _textured(self, region: PatchRegion, index: int) -> Mask:
        """Textured pixels of the patch: bool (h, w)."""
        if self._texture is None or self._texture[0] != index:
            self._texture = index, textured(self.flow.small(index))
        return np.asarray(region.mask & region.crop(self._texture[1]))

    def _earlier(self, region: PatchRegion, index: int) -> FlowToTarget:
        """Flow to the nearest earlier frame of the window that contains the patch."""
        track = region.track
        for gap in range(1, self.params.window):
            labels = self.maps(index - gap) if index - gap >= track.start else None
            pair = self.flow.backward(index, gap)
            if labels is not None and pair is not None and (labels == track.label).any():
                return -gap, *region.direct(*pair, self._textured(region, index), labels, self.params.reliable)
        return -1, *region.without_flow()

    def _later(self, region: PatchRegion, index: int) -> FlowToTarget:
        """Flow to the nearest later frame of the window that contains the patch.

        For gaps above 1 only the flow of the later frame is stored. The homography is fitted to its inverted links.
        """
        track = region.track
        for gap in range(1, self.params.window):
            if index + gap >= min(track.stop, track.end):
                break
            labels = self.maps(index + gap)
            if labels is None or not (labels == track.label).any():
                continue
            if gap == 1 and (pair := self.flow.forward(index)) is not None:
                return 1, *region.direct(*pair, self._textured(region, index), labels, self.params.reliable)
            if (pair := self.flow.backward(index + gap, gap)) is not None:
                return gap, *region.inverted(*pair, labels == track.label, self.params.reliable)
        return 1, *region.without_flow()


def bounding_rect(mask: Mask, margin: int) -> Rect:
    """Bounding box of a mask, extended by `margin` px on each side and clipped to the picture."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return (
        max(int(columns[0]) - margin, 0), max(int(rows[0]) - margin, 0),
        min(int(columns[-1]) + margin + 1, mask.shape[1]), min(int(rows[-1]) + margin + 1, mask.shape[0]),
    )  # fmt: skip


FlowToTarget = tuple[int, Flow, Plane, Homography]
"""Signed gap to the target frame, flow of the region, its reliable pixels (1, else 0), and the fitted homography."""


@dataclass(frozen=True)
class PatchRegion:
    """Region of a patch in a frame.

    Attributes:
        rect: rectangle of the frame, working px.
        mask: bool (h, w), pixels of the patch within the rectangle.
        track: the patch.
    """

    rect: Rect
    mask: Mask
    track: PatchTrack

    def crop(self, plane: AnyArray) -> AnyArray:
        """Crop a plane of the frame to the rectangle."""
        return plane[self.rect[1] : self.rect[3], self.rect[0] : self.rect[2]]

    def direct(
        self, flow: Flow, reliability: Plane, textured: Mask, target_labels: Labels, min_reliability: float
    ) -> tuple[Flow, Plane, Homography]:
        """Flow to the target frame, its reliable pixels (1, else 0), and the fitted homography.

        A flow vector is used if it is reliable, starts on texture, and leads from the patch to the same patch.

        Args:
            flow, reliability: float32, of the whole frame.
            textured: bool (h, w), textured pixels of the patch.
            target_labels: label map of the target frame.
            min_reliability: lowest accepted reliability.
        """
        flow, reliability = self.crop(flow), self.crop(reliability)
        patch = cv2.dilate((target_labels == self.track.label).astype(np.uint8), np.ones((3, 3), np.uint8))
        arrives = warp_labels(patch.astype(np.int32), flow, self.rect[:2]) > 0
        reliable = textured & (reliability >= min_reliability) & arrives
        sources = lattice(textured.shape, self.rect[:2])[reliable]
        matrix = fit(sources, sources + flow[reliable], weights=reliability[reliable], over=self.rect)
        return flow, reliable.astype(np.float32), matrix

    def inverted(
        self, flow: Flow, reliability: Plane, target_mask: Mask, min_reliability: float
    ) -> tuple[Flow, Plane, Homography]:
        """No flow, and the homography fitted to the inverted flow from the target frame to this one.

        Args:
            flow, reliability: flow of the whole target frame to this frame.
            target_mask: bool, pixels of the patch in the target frame.
        """
        reliable = target_mask & (reliability >= min_reliability)
        targets = lattice(target_mask.shape)[reliable]
        matrix = fit(targets + flow[reliable], targets, weights=reliability[reliable], over=self.rect)
        return *self.without_flow()[:2], matrix

    def without_flow(self) -> tuple[Flow, Plane, Homography]:
        """No reliable flow, and the identity."""
        return np.zeros((*self.mask.shape, 2), np.float32), np.zeros(self.mask.shape, np.float32), IDENTITY


def _spring_system(
    flow: Flow, reliable: Plane, matrix: Homography, rect: Rect, mask: Mask, params: PatchesParams
) -> Sheet:
    """Spring system of the patch's pixels: targets from the flow where it is reliable, else from the homography.

    Departure: deviations from the homography below `params.rigidity` are treated as flow noise and removed, so that
    strokes on rigid objects stay rigid. With 0, 0.15 and 0.3 px, the mean change per frame of a painted wall under a
    known pan is 0.52, 0.48 and 0.44 gray levels, that of a static room filmed by webcam 0.79, 0.73 and 0.68. An
    independent warping error, computed with flow as noisy as ours, is 0.85, 0.90 and 0.97 (foreman). The default 0.15
    is a compromise.
    """
    plane, off = np.empty((*mask.shape, 2), np.float32), np.empty((*mask.shape, 2), np.float32)
    _deviate(np.ascontiguousarray(matrix), rect[:2], flow, reliable, plane, off)
    coverage = np.asarray(cv2.GaussianBlur(reliable, (0, 0), 1.5), np.float32)
    smooth = np.asarray(cv2.GaussianBlur(off, (0, 0), 1.5), np.float32)
    targets, stiffness = plane, np.empty(mask.shape, np.float32)
    _add_reliable(off, smooth, coverage, np.float32(params.rigidity), targets)
    _stiffen(reliable, np.float32(params.stiffness), np.float32(params.stiffness * UNRELIABLE_STIFFNESS), stiffness)
    rest_length = float(np.sqrt(abs(np.linalg.det(matrix[:2, :2]))))
    return Sheet(targets, mask, stiffness, rest_length)


@kernel
def _deviate(
    m: Homography, corner: tuple[int, int], flow: Flow, reliable: Plane, plane: Flow, off: Flow
) -> None:  # fmt: skip
    """Positions of the pixels of a rectangle by the homography, and the deviation of reliable flow from them, px."""
    left, top = corner
    for i in range(reliable.shape[0]):
        for j in range(reliable.shape[1]):
            x, y = np.float64(left + j), np.float64(top + i)
            scale = 1.0 / (m[2, 0] * x + m[2, 1] * y + m[2, 2])
            plane[i, j, 0] = (m[0, 0] * x + m[0, 1] * y + m[0, 2]) * scale
            plane[i, j, 1] = (m[1, 0] * x + m[1, 1] * y + m[1, 2]) * scale
            off[i, j, 0] = (np.float32(left + j) + flow[i, j, 0] - plane[i, j, 0]) * reliable[i, j]
            off[i, j, 1] = (np.float32(top + i) + flow[i, j, 1] - plane[i, j, 1]) * reliable[i, j]


@kernel
def _add_reliable(off: Flow, smooth: Flow, coverage: Plane, rigidity: np.float32, targets: Flow) -> None:
    """Add the deviations `off` to the targets, in place, where their smoothed length exceeds `rigidity`."""
    zero, one = np.float32(0), np.float32(1)
    for i in range(coverage.shape[0]):
        for j in range(coverage.shape[1]):
            share = one
            if rigidity > zero:
                known = max(coverage[i, j], np.float32(1e-3))
                u, v = smooth[i, j, 0] / known, smooth[i, j, 1] / known
                keep = min(max(np.sqrt(u * u + v * v) / rigidity - one, zero), one)
                share = keep * keep * (np.float32(3) - np.float32(2) * keep)
            targets[i, j, 0] += off[i, j, 0] * share
            targets[i, j, 1] += off[i, j, 1] * share


@kernel
def _stiffen(reliable: Plane, stiff: np.float32, soft: np.float32, out: Plane) -> None:
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j] = stiff if reliable[i, j] > 0 else soft
