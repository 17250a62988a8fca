"""Optical flow between the frames of a temporal window: computation, reliability, and storage for later steps.

The tasks "flow-<run>" compute the flow once for each pair of frames in a window, in the run of the earlier frame.
Section 4 of zhang2011patches: optical flow links the pixels of the current frame to every other frame of its window.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import AnyArray, State
from pipeline.frames import Flow, Frame, Plane
from pipeline.kernels.ahead import ahead
from pipeline.kernels.float16 import to_half, to_single
from pipeline.kernels.jit import kernel
from pipeline.methods.base import Task, TaskContext, TaskResult
from pipeline.methods.given_motion import GivenMotion, given_motion
from pipeline.methods.patches.params import PatchesParams
from pipeline.methods.patches.scan import WorkingGrid, run_start
from pipeline.perception.flow import estimate
from pipeline.perception.flow.dis import Preset, dis
from pipeline.perception.flow.gray import Gray, to_gray
from pipeline.perception.flow.warp import positions, warp_back

MIN_GRADIENT = 1.0
"""Root mean square of the gradient, gray levels per working px, above which a pixel counts as textured."""
PRESETS: dict[str, tuple[Preset, Preset]] = {"dis-medium": ("medium", "sparse")}
"""Presets of DIS for neighbouring frames, and for frames further apart, whose flow only votes for labels."""
FLOW_THREADS = 4
"""Threads of a task that estimate the flow of different frames, on a machine with many processors."""
MAX_CACHED_FLOWS = 10
"""Maximum number of decoded flow fields in memory, about as many as a frame's window has."""


def flow_key(start: int) -> str:
    """Key of the task that computes the flow of the run that starts at frame `start`."""
    return f"flow-{start:07d}"


def load_kernels() -> None:
    """Load the kernels that the first tasks of a job call; otherwise these tasks wait while one of them loads them."""
    frame, still = np.zeros((16, 16, 3), np.float32), np.zeros((16, 16, 2), np.float32)
    reliability(frame, frame, still, still, 1.0)


def run_flow(task: Task, context: TaskContext[PatchesParams]) -> TaskResult:
    """Compute flow and reliability of all pairs (i, i + k) in the shot, for i in [start, stop) and 1 <= k < window."""
    params = context.params
    reach = (params.window if params.temporal == "on" else 2) - 1
    start, stop, begin, end = (task.args[name] for name in ("start", "stop", "begin", "end"))
    artefacts: dict[str, dict[str, np.ndarray]] = {flow_artefact(stop - 1, 1, begin): {}}
    grid = WorkingGrid.of(context.size)

    def computed(window: _Window) -> tuple[int, Frame, list[State]]:
        first, *later = window.frames
        with context.clock("flow"):
            pairs = (
                flow_pair(first, other, gap, grid, params, given)
                for gap, (other, given) in enumerate(zip(later, window.given, strict=True), start=1)
            )
            return window.index, first.small, [_stored_arrays(each, window.index, k) for k, each in enumerate(pairs, 1)]

    source = context.frames("video", start, min(stop + reach, end))
    windows = _windows(range(start, stop), source, reach, grid, _GivenFlow(given_motion(context), grid))
    with ahead(computed, windows, FLOW_THREADS, "impasto-flow") as found:
        for index, small, pairs in found:
            artefacts.setdefault(flow_artefact(index, 0, begin), {})[f"small-{index}"] = small
            for gap, stored in enumerate(pairs, start=1):
                for name, array in stored.items():
                    where = flow_artefact(index, 0 if name.startswith(_FORWARD) else gap, begin)
                    artefacts.setdefault(where, {})[name] = array
            context.progress((index + 1 - start) / (stop - start))
    for name, arrays in artefacts.items():
        context.save(name, arrays)
    return {}


@dataclass(frozen=True)
class WindowFrame:
    """A frame in the forms that its flow to the other frames of a window needs, each computed once.

    Attributes:
        gray: uint8 (H, W), brightness at full size.
        small: uint8 (h, w, 3), the frame at the working size.
        small_gray: uint8 (h, w), brightness at the working size.
        colours: float32 (h, w, 3), gray levels, `small` blurred by about a pixel to suppress noise.
    """

    gray: Gray
    small: Frame
    small_gray: Gray
    colours: NDArray[np.float32]

    @classmethod
    def of(cls, frame: Frame, grid: WorkingGrid) -> WindowFrame:
        """The forms of a frame, uint8 (H, W, 3)."""
        small = grid.small(frame)
        colours = cv2.GaussianBlur(small, (0, 0), 0.8).astype(np.float32)
        return cls(to_gray(frame), small, to_gray(small), colours)


@dataclass(frozen=True)
class _Window:
    """A frame and the later frames of its window, and the given flow, forward and backward, to each of these."""

    index: int
    frames: list[WindowFrame]
    given: list[tuple[Flow, Flow] | None]


def _windows(
    indices: range, source: Iterator[Frame], reach: int, grid: WorkingGrid, motion: _GivenFlow
) -> Iterator[_Window]:  # fmt: skip
    """The window of each frame, from the frames of the video; `reach`: number of later frames, fewer at the end."""
    queue = list[WindowFrame]()
    for index in indices:
        while len(queue) <= reach and (frame := next(source, None)) is not None:
            queue.append(WindowFrame.of(frame, grid))
        yield _Window(index, queue[:], [motion.between(index, gap) for gap in range(1, len(queue))])
        queue.pop(0)


@dataclass(frozen=True)
class FlowPair:
    """Optical flow between frames i and j = i + gap, at the working size.

    Attributes:
        forward, backward: float32 (h, w, 2), flow from i to j and from j to i, working px.
        forward_reliability: float32 (h, w), 0..1; None for gaps above 1, where nothing reads it.
        backward_reliability: float32 (h, w), 0..1.
    """

    forward: Flow
    backward: Flow
    forward_reliability: Plane | None
    backward_reliability: Plane


class _GivenFlow:
    """Flow over several frames, composed of the motion vectors of the video.

    Args:
        motion: between neighbouring frames.
    """

    def __init__(self, motion: GivenMotion, grid: WorkingGrid) -> None:
        self._motion, self._grid = motion, grid
        self._steps: dict[int, tuple[Flow, Flow] | None] = {}

    def between(self, first: int, gap: int) -> tuple[Flow, Flow] | None:
        """Flow from frame `first` to `first + gap` and back, working px; None: it has to be estimated."""
        self._steps = {index: found for index, found in self._steps.items() if index >= first}
        forward = backward = None
        for index in range(first, first + gap):
            if (step := self._step(index)) is None:
                return None
            forward = step[0] if forward is None else forward + warp_back(step[0], forward)
            backward = step[1] if backward is None else step[1] + warp_back(backward, step[1])
        return None if forward is None or backward is None else (forward, backward)

    def _step(self, index: int) -> tuple[Flow, Flow] | None:
        if index not in self._steps:
            size = self._grid.size
            forth, back = self._motion.flow(index, index + 1, size), self._motion.flow(index + 1, index, size)
            self._steps[index] = None if forth is None or back is None else (forth, back)
        return self._steps[index]


def flow_pair(
    first: WindowFrame, second: WindowFrame, gap: int, grid: WorkingGrid, params: PatchesParams,
    given: tuple[Flow, Flow] | None = None,
) -> FlowPair:  # fmt: skip
    """Forward and backward flow between two frames, and the reliability of each.

    Flow between consecutive frames is computed at full size, since it moves the strokes; over larger gaps, at the
    working size, and with `dis-medium` by a faster preset.

    Args:
        gap: distance of the frames, frames.
        given: forward and backward flow, working px; None: they are estimated.
    """
    forward, backward = given or _estimated_pair(first, second, gap, grid, params)
    of_forward = None
    if gap == 1:
        of_forward = reliability(first.colours, second.colours, forward, backward, params.colour_scale)
    of_backward = reliability(second.colours, first.colours, backward, forward, params.colour_scale)
    return FlowPair(forward, backward, of_forward, of_backward)


def _estimated_pair(
    first: WindowFrame, second: WindowFrame, gap: int, grid: WorkingGrid, params: PatchesParams
) -> tuple[Flow, Flow]:
    here, there = (first.gray, second.gray) if gap == 1 else (first.small_gray, second.small_gray)
    forward, backward = _estimated(here, there, gap, params), _estimated(there, here, gap, params)
    return (grid.downscale_flow(forward), grid.downscale_flow(backward)) if gap == 1 else (forward, backward)


def _estimated(here: Gray, there: Gray, gap: int, params: PatchesParams) -> Flow:
    """Flow from one frame to the other, px."""
    preset = PRESETS.get(params.flow)
    if preset is None:
        return estimate(here, there, params.flow)
    return dis(here, there, preset[min(gap, 2) - 1])


def reliability(
    first: NDArray[np.float32], second: NDArray[np.float32], flow: Flow, reverse: Flow, colour_scale: float
) -> Plane:  # fmt: skip
    """Reliability R_xy = exp(-|c_x - c_y|) of the links between pixels x and y: float32 (h, w), 0..1.

    Args:
        first, second: float32 (h, w, 3), blurred colours of both frames, see `WindowFrame`.
        flow: float32 (h, w, 2), flow from the first frame to the second, px.
        reverse: float32 (h, w, 2), flow from the second frame to the first, px.
        colour_scale: unit of the RGB distance, gray levels.

    Source: zhang2011patches, section 4. Departures: the paper does not give the unit of colours; with 0..255 every R
    is about 0, with 0..1 hardly any is below 0.2. Links that fail the forward-backward check get R = 0, since occluded
    pixels have no partner, and links that pass it only approximately get half of R. Colours are blurred by about a
    pixel to suppress noise.
    """
    x, y = positions(flow)
    there, returned = (
        np.asarray(cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), np.float32)
        for image in (second, reverse)
    )
    exponent, share = np.empty(x.shape, np.float32), np.empty(x.shape, np.float32)
    _compare(first, there, flow, returned, np.float32(colour_scale), exponent, share)
    return np.asarray(np.multiply(np.exp(exponent, out=exponent), share, out=share), np.float32)


@kernel
def _compare(
    first: NDArray[np.float32], there: NDArray[np.float32], flow: Flow, returned: Flow, scale: np.float32,
    exponent: Plane, share: Plane,
) -> None:  # fmt: skip
    """Colour differences of links, in units of `-scale`, and their share of R by the forward-backward check.

    The share is 1 if the check is passed, 0.5 if it is passed approximately (usual in smooth areas), 0 if it fails.
    """
    height, width = share.shape
    for y in range(height):
        for x in range(width):
            red, green = first[y, x, 0] - there[y, x, 0], first[y, x, 1] - there[y, x, 1]
            blue = first[y, x, 2] - there[y, x, 2]
            exponent[y, x] = -np.sqrt(red * red + green * green + blue * blue) / scale
            u, v, back_u, back_v = flow[y, x, 0], flow[y, x, 1], returned[y, x, 0], returned[y, x, 1]
            length = (u * u + back_u * back_u) + (v * v + back_v * back_v)
            error = (u + back_u) * (u + back_u) + (v + back_v) * (v + back_v)
            passed = error <= np.float32(0.01) * length + np.float32(0.5)
            nearly = error <= np.float32(0.04) * length + np.float32(2.5)
            to_x, to_y = np.float32(x) + u, np.float32(y) + v
            within = to_x >= 0 and to_y >= 0 and to_x <= width - 1 and to_y <= height - 1
            share[y, x] = (np.float32(passed) + np.float32(nearly)) * np.float32(0.5) * np.float32(within)


def vector_norm(vectors: AnyArray) -> Plane:
    """Euclidean norm over the last axis: float32 (h, w). Faster than `np.linalg.norm` for 2 or 3 components."""
    square = vectors[..., 0] * vectors[..., 0]
    for channel in range(1, vectors.shape[-1]):
        square += vectors[..., channel] * vectors[..., channel]
    return np.asarray(np.sqrt(square), np.float32)


def textured(small: Frame) -> NDArray[np.bool_]:
    """Pixels with enough texture for reliable motion: bool (h, w).

    Flow in smooth areas is interpolated from elsewhere or follows noise, so it is no evidence for clustering.

    Args:
        small: uint8 (h, w, 3), a frame at the working size.
    """
    gray = cv2.GaussianBlur(cv2.cvtColor(small, cv2.COLOR_RGB2GRAY).astype(np.float32), (0, 0), 1.0)
    dx = cv2.Scharr(gray, cv2.CV_32F, 1, 0, scale=1 / 32)
    dy = cv2.Scharr(gray, cv2.CV_32F, 0, 1, scale=1 / 32)
    return np.asarray(cv2.blur(dx * dx + dy * dy, (7, 7)) > MIN_GRADIENT**2)


# -- storage

_FORWARD, _BACKWARD = "forward", "backward"


def _stored_arrays(pair: FlowPair, index: int, gap: int) -> State:
    """Arrays of an artefact: flow in half precision (1/64 px at 32 px, finer below), reliability in 255 steps.

    The forward flow is stored for consecutive frames only, since later steps do not read it over larger gaps.
    """
    stored = {_BACKWARD: (pair.backward, pair.backward_reliability)}
    if pair.forward_reliability is not None:
        stored[_FORWARD] = (pair.forward, pair.forward_reliability)
    arrays: State = {}
    for direction, (flow, reliable) in stored.items():
        arrays[f"{direction}-flow-{index}-{gap}"] = to_half(np.clip(flow, -6e4, 6e4))
        arrays[f"{direction}-reliability-{index}-{gap}"] = np.rint(reliable * 255).astype(np.uint8)
    return arrays


def flow_artefact(index: int, gap: int, begin: int) -> str:
    """Name of the artefact with the flow from frame `index + gap` back to `index`, in the shot that starts at `begin`.

    Gap 0 means the small frame and the forward flow. Arrays that are read together are stored together:

    flow-<run>   small frames, forward flow, and backward flow between consecutive frames; read by every step
    far-<run>    backward flow over larger gaps within the run; read mainly for clustering
    over-<run>   backward flow from the next run into this run
    """
    start, last = (run_start(frame, begin) for frame in (index, index + gap))
    return f"{'over' if last > start else 'far' if gap > 1 else 'flow'}-{start:07d}"


class WindowFlow:
    """Reads the flow of a shot that the tasks "flow-<run>" have stored.

    Args:
        begin: first frame of the shot.
        max_artefacts: number of artefacts held in memory.
    """

    def __init__(self, context: TaskContext[PatchesParams], begin: int, max_artefacts: int = 6) -> None:
        self._context, self._begin, self._max_artefacts = context, begin, max_artefacts
        self._artefacts: OrderedDict[str, State] = OrderedDict()
        self._flows: OrderedDict[str, tuple[Flow, Plane] | None] = OrderedDict()

    def small(self, index: int) -> Frame:
        """Frame `index` at the working size: uint8 (h, w, 3)."""
        found = self._array(f"small-{index}", index, 0)
        assert found is not None
        return found

    def backward(self, index: int, gap: int = 1) -> tuple[Flow, Plane] | None:
        """Flow from frame `index` to `index - gap` and its reliability; None if that is outside the shot.

        Flow: float32 (h, w, 2), working px. Reliability: float32 (h, w), 0..1. Both are read-only.
        """
        return self._flow(_BACKWARD, index - gap, gap)

    def forward(self, index: int) -> tuple[Flow, Plane] | None:
        """Flow from frame `index` to the next and its reliability; None at the end of the shot."""
        return self._flow(_FORWARD, index, 1)

    def _flow(self, direction: str, index: int, gap: int) -> tuple[Flow, Plane] | None:
        name = f"{direction}-{index}-{gap}"
        if name not in self._flows:
            self._flows[name] = self._decoded(direction, index, gap)
            while len(self._flows) > MAX_CACHED_FLOWS:
                self._flows.popitem(last=False)
        return self._flows[name]

    def _decoded(self, direction: str, index: int, gap: int) -> tuple[Flow, Plane] | None:
        stored_gap = 0 if direction == _FORWARD else gap
        flow = self._array(f"{direction}-flow-{index}-{gap}", index, stored_gap)
        reliable = self._array(f"{direction}-reliability-{index}-{gap}", index, stored_gap)
        if flow is None or reliable is None:
            return None
        pair = to_single(flow), reliable.astype(np.float32) / np.float32(255)
        for array in pair:
            array.setflags(write=False)
        return pair

    def _array(self, name: str, index: int, gap: int) -> AnyArray | None:
        if index < self._begin:
            return None
        where = flow_artefact(index, gap, self._begin)
        if where not in self._artefacts:
            self._artefacts[where] = self._context.load("cluster", where)
            while len(self._artefacts) > self._max_artefacts:
                self._artefacts.popitem(last=False)
        self._artefacts.move_to_end(where)
        return self._artefacts[where].get(name)
