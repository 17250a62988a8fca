"""Face tracking: occasional detection (viola2001rapid) and motion in between, as soft masks of whole heads.

A detector that runs on every frame costs more than the rest of a method, and its boxes jitter and drop out. The whole
frame is therefore searched only at intervals, spread over several frames, and the surroundings of known faces between
two such searches. In the other frames a face moves with the median flow inside its box. Its box follows the latest
detection gradually, and its strength rises and falls gradually. The more detections a face has, the longer it is kept
without a new one.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Arrays, State
from pipeline.frames import Flow, Plane
from pipeline.segmentation.face_detector import SLICES, Boxes, FaceDetector, join, slices
from pipeline.segmentation.motion import median_motion

FACE = np.dtype([
    ("box", np.float64, (4,)), ("detected", np.float64, (4,)), ("strength", np.float64), ("age", np.float64),
    ("detections", np.float64),
])  # fmt: skip
"""A face: smoothed box and latest detected box, (centre x, centre y, width, height) in px of the frame; strength, 0..1;
frames since the latest detection; number of detections."""
Faces = NDArray[np.void]
"""Structured (`FACE`), (n,)."""
_COLUMNS = FACE.itemsize // np.dtype(np.float64).itemsize
"""Columns of faces as stored: float64 (n, _COLUMNS), the fields of `FACE` in order."""
_NEARBY_SEARCHES = 2
"""Searches around known faces between two searches of the whole frame."""
_MIN_PATIENCE, _MAX_PATIENCE = 1.0, 2.0
"""Time that a face is kept after its first and after many detections, in units of `keep_frames`."""
_SCALE_FACTOR = 1.2
_FINE_SCALE_FACTOR = 1.08
_HALF_WIDTH, _HALF_HEIGHT, _RAISE = 0.55, 0.75, 0.1
"""Semi-axes of the head's ellipse and its upward shift, in sides of the detected box, which ends at brows and chin."""
_FADE = 1.5
"""The mask falls from 1 at the head's ellipse to 0 at an ellipse this many times larger."""


@dataclass
class _Search:
    """A search of a whole picture in progress.

    Attributes:
        gray: uint8 (h, w), the picture.
        hits: int32 (n, 4), windows found so far.
        done: number of slices searched.
        flows: flow of each frame since the picture.
    """

    gray: NDArray[np.uint8]
    hits: NDArray[np.int32] = field(default_factory=lambda: np.empty((0, 4), np.int32))
    done: int = 0
    flows: list[Flow] = field(default_factory=list)


class FaceTracker:
    """Tracks the faces of one shot. Not thread-safe. The cascade is read on the first detection.

    Args:
        size: (width, height) of the frames, px.
        every_frames: frames between searches of the whole frame, counted from the first frame of the shot.
        half_life_frames: half-life with which boxes and strengths follow the detections; 0 = at once.
        smallest: smallest face, as a fraction of the frame's shorter side.
        keep_frames: frames that a face is kept after its first detection; None = `every_frames`.

    Attributes:
        faces: the current faces.
    """

    def __init__(
        self, size: tuple[int, int], every_frames: int, half_life_frames: float, smallest: float,
        keep_frames: int | None = None,
    ) -> None:  # fmt: skip
        self._size = size
        self._keep = every_frames if keep_frames is None else keep_frames
        self._every = every_frames
        self._gain = 1.0 - 0.5 ** (1.0 / half_life_frames) if half_life_frames > 0 else 1.0
        self._smallest = smallest
        self._finder = FaceDetector()
        self._search: _Search | None = None
        self.faces: Faces = np.empty(0, FACE)

    def needs_picture(self, age: int) -> bool:
        """Whether `step` needs the picture of frame number `age` of the shot."""
        return age % max(1, self._every // _NEARBY_SEARCHES) == 0 or age % self._every == 0

    def step(self, gray: NDArray[np.uint8] | None, flow: Flow | None, age: int) -> None:
        """Process frame number `age` of the shot.

        Args:
            gray: the frame, scaled down; may be None if `needs_picture` is false.
            flow: from the previous frame, px of the frame, on a grid of any size.
            age: 0 = a shot begins; all faces are removed.
        """
        if age == 0:
            self.faces, self._search = np.empty(0, FACE), None
        elif flow is not None:
            shifts = self._shifts(self.faces["box"], flow)
            self.faces["box"][:, :2] += shifts
            self.faces["detected"][:, :2] += shifts
            if self._search:
                self._search.flows.append(flow)
        self.faces["age"] += 1
        if self._search and self._search.done == SLICES:
            self._add_search_result(self._search)
        if gray is not None and age % self._every == 0:
            self._begin(gray, at_once=age == 0 or self._every <= SLICES, fresh=age == 0)
        elif gray is not None and not self._search and age % max(1, self._every // _NEARBY_SEARCHES) == 0:
            self._match(self._search_nearby(gray), allow_new=False)
        self._smooth()

    def _begin(self, gray: NDArray[np.uint8], at_once: bool, fresh: bool) -> None:
        self._search = _Search(gray)
        while at_once and self._search.done < SLICES:
            self.continue_search()
        if at_once:
            self._add_search_result(self._search, fresh)

    def continue_search(self) -> None:
        """Search the next slice of a search in progress, if any. Call it once after each `step`, or never."""
        search = self._search
        if search is None or search.done == SLICES:
            return
        least = max(20, round(self._smallest * min(search.gray.shape)))
        sizes = slices(_SCALE_FACTOR, least, min(search.gray.shape))[search.done]
        search.hits = np.vstack([search.hits, self._finder.hits(search.gray, _SCALE_FACTOR, *sizes)])
        search.done += 1

    def _add_search_result(self, search: _Search, fresh: bool = False) -> None:
        """Match the result of a complete search, moved along the flow since its picture."""
        boxes = join(search.hits) / self._scale(search.gray)
        for flow in search.flows:
            boxes[:, :2] += self._shifts(boxes, flow)
        self._match(boxes, allow_new=True, fresh=fresh)
        self._search = None

    def state(self) -> State:
        """State as arrays by name; a tracker restored from it continues with the same bytes."""
        state: State = {"faces": self.faces.view(np.float64).reshape(-1, _COLUMNS).copy()}
        if self._search:
            search = self._search
            state |= {"search.gray": search.gray, "search.hits": search.hits, "search.done": np.array(search.done)}
            if search.flows:
                state["search.flows"] = np.stack(search.flows)
        return state

    def restore(self, state: Arrays) -> None:
        self.faces = np.array(state["faces"], np.float64).view(FACE)[:, 0]
        self._search = None
        if "search.gray" in state:
            gray, hits = np.asarray(state["search.gray"], np.uint8), np.asarray(state["search.hits"], np.int32)
            self._search = _Search(gray, hits, int(state["search.done"]), list(state.get("search.flows", ())))

    def head_mask(self, shape: tuple[int, int]) -> Plane:
        """Soft mask of the heads, times their strength: float32, a grid of `shape` over the frame, 0..1."""
        height, width = shape
        xs = (np.arange(width, dtype=np.float32) + 0.5) * np.float32(self._size[0] / width)
        ys = (np.arange(height, dtype=np.float32) + 0.5) * np.float32(self._size[1] / height)
        plane = np.zeros(shape, np.float32)
        for face in self.faces:
            cx, cy, w, h = face["box"].astype(np.float32)
            strength = np.float32(face["strength"])
            across = ((xs - cx) / (w * np.float32(_HALF_WIDTH))) ** 2
            down = ((ys - cy + h * np.float32(_RAISE)) / (h * np.float32(_HALF_HEIGHT))) ** 2
            distance = np.sqrt(across[None, :] + down[:, None])
            ramp = np.clip((np.float32(_FADE) - distance) / np.float32(_FADE - 1), 0, 1)
            np.maximum(plane, strength * ramp * ramp * (3 - 2 * ramp), out=plane)
        return plane

    def _shifts(self, boxes: Boxes, flow: Flow) -> NDArray[np.float64]:
        """Median flow in the middle half of each box, float64 (n, 2), px; 0 for boxes outside the flow's grid."""
        scale = np.array([flow.shape[1] / self._size[0], flow.shape[0] / self._size[1]])
        out = np.zeros((len(boxes), 2))
        for shift, box in zip(out, boxes, strict=True):
            centre, quarter = box[:2] * scale, box[2:] * scale / 4
            (x0, y0), (x1, y1) = np.maximum(centre - quarter, 0).astype(int), np.ceil(centre + quarter).astype(int)
            inside = flow[y0 : y1 + 1, x0 : x1 + 1]
            if inside.size:
                shift[:] = median_motion(inside)
        return out

    def _search_nearby(self, gray: NDArray[np.uint8]) -> Boxes:
        """Faces near known faces, px of the frame: searched in twice the area, at similar sizes, in finer steps of
        size."""
        found = [np.empty((0, 4))]
        for cx, cy, width, height in self.faces["detected"] * self._scale(gray):
            x, y = max(0, int(cx - width)), max(0, int(cy - height))
            window = gray[y : int(cy + height) + 1, x : int(cx + width) + 1]
            if min(window.shape) > 20:
                boxes = self._finder.find(window, _FINE_SCALE_FACTOR, max(20, int(width * 0.75)), int(width * 1.35))
                boxes[:, :2] += x, y
                found.append(boxes / self._scale(gray))
        return np.vstack(found)

    def _scale(self, gray: NDArray[np.uint8]) -> NDArray[np.float64]:
        return np.tile([gray.shape[1] / self._size[0], gray.shape[0] / self._size[1]], 2)

    def _match(self, boxes: Boxes, allow_new: bool, fresh: bool = False) -> None:
        """Assign each detection to the nearest unmatched face, or to a new face if `allow_new`.

        Args:
            fresh: whether new faces have full strength at once.
        """
        free = np.ones(len(self.faces), bool)
        known, new = self.faces["detected"], []
        for box in boxes:
            apart = np.linalg.norm(known[:, :2] - box[:2], axis=1) / np.maximum(known[:, 2], box[2])
            near = np.flatnonzero(free & (apart < 0.5))
            if near.size:
                nearest = int(near[apart[near].argmin()])
                free[nearest] = False
                self._update(nearest, box)
            elif allow_new:
                new.append((box, box, float(fresh), 0.0, 1.0))
        self.faces = np.concatenate([self.faces, np.array(new, FACE)])

    def _update(self, index: int, box: NDArray[np.float64]) -> None:
        self.faces["detected"][index] = box
        self.faces["age"][index] = 0
        self.faces["detections"][index] += 1

    def _smooth(self) -> None:
        """Update boxes and strengths, and remove faces that are lost or outside the frame."""
        faces, centres = self.faces, self.faces["detected"][:, :2]
        current = faces["age"] <= self._keep * np.clip(faces["detections"] / 4, _MIN_PATIENCE, _MAX_PATIENCE)
        faces["box"] += self._gain * (faces["detected"] - faces["box"])
        faces["strength"] += self._gain * (current - faces["strength"])
        inside = ((centres >= 0) & (centres < self._size)).all(axis=1)
        self.faces = faces[(current | (faces["strength"] > 0.02)) & inside]
