"""Face tracking: detection spread over frames (viola2001rapid) and motion in between, as soft masks of whole heads.

A complete search costs more than the rest of a frame, and a detector's boxes jitter and drop out. The first frame of a
shot is searched completely for frontal faces. Every later frame (in small ones every fourth, with larger pieces)
searches one piece of the frame for new faces, so that all pieces are searched in a cycle; every second frame searches
the surroundings of one known face. In between, a face moves with the median flow inside its box. Its box follows the
latest detection gradually, and its strength rises and falls gradually.

A candidate becomes a face if a fine search of its surroundings confirms it; the more often that happens again, the
longer the face is kept without a detection. A pattern that looks like a face in one frame is soon removed.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Arrays, State
from pipeline.flow.gray import Gray
from pipeline.frames import Flow, Plane
from pipeline.jit import kernel
from pipeline.segmentation.face_detector import LEAST_HITS, POSES, WINDOW_PX, FaceDetector, Pose, pieces, pose_pieces
from pipeline.segmentation.motion import median_motion
from pipeline.segmentation.new_places import LARGEST, NewPlaces

FACE = np.dtype([
    ("box", np.float64, (4,)), ("detected", np.float64, (4,)), ("strength", np.float64),
    ("detections", np.float64), ("misses", np.float64), ("unchecked", np.float64), ("pose", np.float64),
])  # fmt: skip
"""A face: smoothed box and latest detected box, (centre x, centre y, width, height) in px of the frame; strength, 0..1;
number of detections; number of searches without one since the latest; frames since its surroundings were searched; pose
at the latest detection, index into `POSES`."""
Faces = NDArray[np.void]
"""Structured (`FACE`), (n,)."""
NO_FACES: Faces = np.empty(0, FACE)
_COLUMNS = FACE.itemsize // np.dtype(np.float64).itemsize
"""Columns of faces as stored: float64 (n, _COLUMNS), the fields of `FACE` in order."""
_CYCLE_FRAMES, _PIECE_WINDOWS = 160, 4000.0
"""Frames of a complete search of all poses, and windows of a piece above which it takes longer instead."""
_MOST_APART = 4
"""Most frames from one searched piece to the next. Below `_PIECE_WINDOWS`, a piece of fewer windows costs hardly less,
so small frames are searched in fewer and larger pieces."""
_SMALLEST_SHARE = 1 / 48
"""Smallest face, as a fraction of the frame's longer side; at least the detector's window."""
_RECHECK_FRAMES = 8
"""Frames between two searches around a known face, if no other face has waited for longer."""
_FIRST_RECHECK_FRAMES = 4
"""The same after the first detection, which may be false."""
_RECHECK_WIDTHS = 72.0
"""Sum of the widths, px, of the faces whose surroundings are searched in a frame."""
_MIRRORED_PX = 36.0
"""Least width of a frontal face, px, that must be found in the mirrored picture, too. Patterns in grass or folds of
clothes that resemble a face are not symmetric. Smaller faces have too few pixels for this test."""
_LARGE_PX, _LARGE_HITS = 72.0, 5
"""Width of a new frontal face, px, from which the cascade must accept more windows at its place, and how many. A large
false face is seen, since fine strokes on it look like a photograph. Most real ones have over 20 windows."""
_MOST_CANDIDATES = 3
"""Candidates of a frame that are looked at closely."""
_LEAST_MISSES, _MOST_MISSES = 2, 6
"""Limits of the number of searches without detection after which a face is dropped; in between, it equals the number of
its detections."""
_HALF_WIDTH, _HALF_HEIGHT, _RAISE = 0.55, 0.75, 0.1
"""Semi-axes of the head's ellipse and its upward shift, in sides of the detected box, which ends at brows and chin."""
_LEAST_CELLS = 1.5
"""Smallest semi-axis, in cells of the mask's grid: the mask of a small face would otherwise fall between them."""
SMALL_FACE, LARGE_FACE = 0.2, 0.4
"""Widths of a face, in shorter sides of the frame, between which the weight of `small_faces` falls from 1 to 0."""
_FADE = 1.5
"""The mask falls from 1 at the head's ellipse to 0 at an ellipse this many times larger."""
_FEATURES_WIDTH, _FEATURES_HEIGHT, _FEATURES_FADE = 0.36, 0.405, 1.4
"""Semi-axes of the ellipse around brows, eyes, nose and mouth, in sides of the detected box, and its fade."""


_EYE_APART, _EYE_RAISE, _EYE_WIDTH, _EYE_HEIGHT = 0.2, 0.14, 0.15, 0.11
"""Distance from the middle of the detected box to the middle of an eye and its brow, to the side and upwards, and
semi-axes of the ellipse around both, in sides of the box."""


class FaceTracker:
    """Tracks the faces of one shot. Not thread-safe. The cascades are read on the first detection.

    Args:
        size: (width, height) of the frames, px.
        half_life_frames: half-life with which boxes and strengths follow the detections; 0 = at once.

    Attributes:
        faces: the current faces.
    """

    def __init__(self, size: tuple[int, int], half_life_frames: float) -> None:
        self._size = size
        self._gain = 1.0 - 0.5 ** (1.0 / half_life_frames) if half_life_frames > 0 else 1.0
        self._finder = FaceDetector()
        least = max(WINDOW_PX, round(max(size) * _SMALLEST_SHARE))
        windows = size[0] * size[1] * (WINDOW_PX / least) ** 2
        # All window sizes and poses together test about 1.6 times as many windows as the unscaled picture has pixels.
        least_pieces = 1.6 * windows / _PIECE_WINDOWS
        self._apart = min(max(1, round(_CYCLE_FRAMES / least_pieces)), _MOST_APART)
        self._pieces = pieces(size, least, max(_CYCLE_FRAMES // self._apart, round(least_pieces)))
        self._first = pose_pieces(size, "frontal", least)
        self._least, self._new = least, NewPlaces(size, least)
        self.faces: Faces = NO_FACES

    def step(self, gray: Gray, flow: Flow | None, age: int) -> None:
        """Process frame number `age` of the shot: move the faces, and search the first frame.

        Args:
            gray: uint8 (height, width), the frame.
            flow: from the previous frame, px of the frame, on a grid of any size.
            age: 0 = a shot begins; all faces are removed.
        """
        if age == 0:
            self.faces = NO_FACES
            self.search_whole(gray, strength=1.0)
        elif flow is not None:
            shifts = self._shifts(self.faces["box"], flow)
            self.faces["box"][:, :2] += shifts
            self.faces["detected"][:, :2] += shifts
            self._new.move(flow)
        self.faces["unchecked"] += 1
        self._smooth()

    def search_whole(self, gray: Gray, strength: float = 0.0) -> None:
        """Search the whole frame for new frontal faces, which begin with that strength, 0..1.

        Args:
            gray: uint8 (height, width), the frame.
        """
        for piece in self._first:
            self._add(gray, self._finder.candidates(gray, piece), piece.pose, strength)
        self._new.clear()

    def search(self, gray: Gray, age: int) -> None:
        """Search the next piece of the frame, a place that is new in it, and the surroundings of known faces, for later
        frames.

        Args:
            gray, age: as in the latest `step`. Call it once after each `step`.
        """
        if self._pieces and age % self._apart == 0:
            piece = self._pieces[age // self._apart % len(self._pieces)]
            self._add_new(gray, self._finder.candidates(gray, piece)[:_MOST_CANDIDATES], piece.pose)
        self._search_new(gray, age)
        self._recheck_due(gray, age)

    def _recheck_due(self, gray: Gray, age: int) -> None:
        """Search around the known faces that have waited for longest: several small ones, or in every second frame one
        large one."""
        budget = _RECHECK_WIDTHS
        for index in np.argsort(-self.faces["unchecked"], kind="stable"):
            face = self.faces[index]
            wait = _RECHECK_FRAMES if face["detections"] > 1 else _FIRST_RECHECK_FRAMES
            width = float(face["detected"][2])
            if face["unchecked"] < wait or (width > budget and (not age % 2 or budget < _RECHECK_WIDTHS)):
                continue
            self._recheck(gray, int(index))
            budget -= width

    def _search_new(self, gray: Gray, age: int) -> None:
        """Search a place that has come into view, or in which something moves."""
        where = self._new.next_rectangle(age)
        if where is None:
            return
        self._add_new(
            gray, self._finder.candidates_in(gray, where, self._least, round(LARGEST * self._least)), "frontal"
        )
        self._new.searched(where)

    def _add_new(self, gray: Gray, candidates: NDArray[np.float64], pose: Pose) -> None:
        """`_add` with faces that begin as strong as their places are new."""
        for candidate in candidates:
            self._add(gray, candidate[None], pose, self._new.newness(candidate))

    def state(self) -> State:
        """State as arrays by name; a tracker restored from it continues with the same bytes."""
        return {
            "faces": self.faces.view(np.float64).reshape(-1, _COLUMNS).copy(),
            "unsearched": self._new.unsearched.copy(), "moving": self._new.moving.copy(),
        }  # fmt: skip

    def restore(self, state: Arrays) -> None:
        """Restore a state; one without `unsearched` or `moving` has no such places; other sizes are resampled."""
        self.faces = faces_of_state(state)
        self._new.restore(state.get("unsearched"), state.get("moving"))

    def _shifts(self, boxes: NDArray[np.float64], flow: Flow) -> NDArray[np.float64]:
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

    def _add(self, gray: Gray, candidates: NDArray[np.float64], pose: Pose, strength: float) -> None:
        """Add a face for each confirmed candidate that is not a known face."""
        for candidate in candidates:
            if self._known(candidate) is not None:
                continue
            box = self._finder.confirm(gray, candidate, pose, _hits_of_new(candidate, pose))
            if box is not None and self._known(box) is None and self._is_symmetric(gray, box, pose):
                face = np.array([(box, box, strength, 1.0, 0.0, 0.0, POSES.index(pose))], FACE)
                self.faces = np.concatenate([self.faces, face])

    def _is_symmetric(self, gray: Gray, box: NDArray[np.float64], pose: Pose) -> bool:
        """Whether a large frontal face is found in the mirrored picture, too; True for all others."""
        asked = pose == "frontal" and box[2] >= _MIRRORED_PX
        return not asked or self._finder.confirm(gray, box, "mirrored", _hits_of_new(box, pose)) is not None

    def _known(self, box: NDArray[np.float64]) -> int | None:
        """The face at that place and of about that size; None = there is none."""
        known = self.faces["detected"]
        apart = np.linalg.norm(known[:, :2] - box[:2], axis=1) / np.maximum(known[:, 2], box[2])
        near = np.flatnonzero(apart < 0.5)
        return int(near[apart[near].argmin()]) if near.size else None

    def _recheck(self, gray: Gray, index: int) -> None:
        """Search around a known face: in its latest pose, else frontally, else in one of the other poses, which
        alternate."""
        face = self.faces[index]
        face["unchecked"] = 0.0
        latest = int(face["pose"])
        turns = int(face["misses"]) % len(POSES)
        for pose in dict.fromkeys((latest, 0, turns)):
            box = self._finder.confirm(gray, face["detected"], POSES[pose])
            if box is not None:
                face["detected"], face["misses"], face["pose"] = box, 0.0, pose
                face["detections"] += 1
                return
        face["misses"] += 1

    def _smooth(self) -> None:
        """Update boxes and strengths, and remove faces that are lost or outside the frame."""
        if not len(self.faces):
            return
        faces, centres = self.faces, self.faces["detected"][:, :2]
        current = faces["misses"] < np.clip(faces["detections"], _LEAST_MISSES, _MOST_MISSES)
        faces["box"] += self._gain * (faces["detected"] - faces["box"])
        faces["strength"] += self._gain * (current - faces["strength"])
        inside = ((centres >= 0) & (centres < self._size)).all(axis=1)
        self.faces = faces[(current | (faces["strength"] > 0.02)) & inside]


def _hits_of_new(box: NDArray[np.float64], pose: Pose) -> int:
    """Number of windows at the place of a new face of that size and pose that the cascade must accept."""
    return _LARGE_HITS if pose == "frontal" and box[2] >= _LARGE_PX else LEAST_HITS


class FaceCrop(NamedTuple):
    """A face in a picture.

    Attributes:
        box: rows and columns of the picture.
        weight: float32, 0..1, of the shape of `box`: by how much the pixels belong to the face, times its
            strength and a factor, see `face_crops`.
        face: centre x, centre y, width and height of the detected box, px of the picture.
    """

    box: tuple[slice, slice]
    weight: Plane
    face: tuple[float, float, float, float]

    @property
    def width_px(self) -> float:
        return self.face[2]

    def features(self) -> Plane:
        """`weight` where brows, eyes, nose and mouth are, and 0 on the outline of the head: float32, of its shape."""
        cx, cy, w, h = self.face
        return self.weight * _soft_ellipse(
            self.box, (cx, cy), (w * _FEATURES_WIDTH, h * _FEATURES_HEIGHT), _FEATURES_FADE
        )

    def eyes(self) -> Plane:
        """`weight` where the eyes and brows of a frontal face are: float32, of its shape."""
        cx, cy, w, h = self.face
        semi_axes = w * _EYE_WIDTH, h * _EYE_HEIGHT
        left, right = (
            _soft_ellipse(self.box, (cx + side * w * _EYE_APART, cy - h * _EYE_RAISE), semi_axes, _FADE)
            for side in (-1, 1)
        )
        return self.weight * np.maximum(left, right)

    def blend(self, plane: NDArray[np.uint8], other: NDArray[np.uint8]) -> None:
        """Move that part of a plane, uint8 (h, w), towards `other`, of the shape of `box`, by the weight."""
        _blend(plane[self.box], other, self.weight)


@kernel
def _blend(own: NDArray[np.uint8], other: NDArray[np.uint8], weight: Plane) -> None:
    for y in range(own.shape[0]):
        for x in range(own.shape[1]):
            mine = np.float32(own[y, x])
            own[y, x] = np.uint8(np.rint(mine + weight[y, x] * (np.float32(other[y, x]) - mine)))


def largeness(faces: Faces, size: tuple[int, int]) -> NDArray[np.float64]:
    """0 up to a width of `SMALL_FACE`, rising to 1 at `LARGE_FACE`: float64 (n,).

    Args:
        size: (width, height) of the frame, in whose px the faces are.
    """
    shares = faces["box"][:, 2] / min(size)
    return np.asarray(np.clip((shares - SMALL_FACE) / (LARGE_FACE - SMALL_FACE), 0, 1), np.float64)


def small_faces(faces: Faces, size: tuple[int, int], picture: tuple[int, int]) -> list[FaceCrop]:
    """The small faces: weight 1 up to a width of `SMALL_FACE`, falling to 0 at `LARGE_FACE`.

    Args:
        size, picture: (width, height) of the frame, in whose px the faces are, and of the picture.
    """
    return face_crops(faces, size, picture, 1 - largeness(faces, size))


def face_crops(
    faces: Faces, size: tuple[int, int], picture: tuple[int, int], factors: NDArray[np.float64]
) -> list[FaceCrop]:  # fmt: skip
    """Faces in a picture whose weight is their strength times a factor each, without those of no weight.

    Args:
        size, picture: as for `small_faces`.
        factors: (n,), 0..1.
    """
    out = []
    across, down = np.divide(picture, size)
    boxes = faces["box"] * (across, down, across, down)
    weights = (faces["strength"] * factors).astype(np.float32)
    for (cx, cy, w, h), weight in zip(boxes.tolist(), weights, strict=True):
        half_x, half_y, top = w * _HALF_WIDTH, h * _HALF_HEIGHT, cy - h * _RAISE
        x0, x1 = max(0, math.floor(cx - _FADE * half_x)), min(picture[0], math.ceil(cx + _FADE * half_x))
        y0, y1 = max(0, math.floor(top - _FADE * half_y)), min(picture[1], math.ceil(top + _FADE * half_y))
        if weight < 0.02 or x0 >= x1 or y0 >= y1:
            continue
        box = slice(y0, y1), slice(x0, x1)
        head = _soft_ellipse(box, (cx, top), (half_x, half_y), _FADE)
        out.append(FaceCrop(box, weight * head, (cx, cy, w, h)))
    return out


def _soft_ellipse(
    box: tuple[slice, slice], centre: tuple[float, float], semi_axes: tuple[float, float], fade: float
) -> Plane:
    """1 in an ellipse, falling to 0 at `fade` times its size: float32, of the shape of `box`.

    Args:
        box: rows and columns of a picture; centre, semi_axes: (x, y), px of the picture.
    """
    rows, columns = box
    out = np.empty((rows.stop - rows.start, columns.stop - columns.start), np.float32)
    shifts = np.float32(0.5 - centre[0]), np.float32(0.5 - centre[1])
    units = np.float32(semi_axes[0]), np.float32(semi_axes[1])
    _fill_ellipse(out, (columns.start, rows.start), shifts, units, np.float32(fade))
    return out


@kernel
def _fill_ellipse(
    out: Plane, corner: tuple[int, int], shifts: tuple[np.float32, np.float32], units: tuple[np.float32, np.float32],
    fade: np.float32,
) -> None:  # fmt: skip
    """`_soft_ellipse` of a box with that first pixel (x, y). `shifts`: what is added to a pixel for its distance from
    the centre; `units`: the semi-axes."""
    height, width = out.shape
    squares = np.empty(width, np.float32)
    for x in range(width):
        across = (np.float32(corner[0] + x) + shifts[0]) / units[0]
        squares[x] = across * across
    for y in range(height):
        down = (np.float32(corner[1] + y) + shifts[1]) / units[1]
        for x in range(width):  # this vectorises
            out[y, x] = _soft_edge(np.sqrt(squares[x] + down * down), fade)


@kernel
def _soft_edge(distance: np.float32, fade: np.float32) -> np.float32:
    """1 up to a distance of 1, falling to 0 at `fade`."""
    ramp = min(max((fade - distance) / (fade - np.float32(1)), np.float32(0)), np.float32(1))
    return ramp * ramp * (np.float32(3) - np.float32(2) * ramp)


def faces_of_state(state: Arrays) -> Faces:
    """The faces in the state of a tracker."""
    return np.array(state["faces"], np.float64).view(FACE)[:, 0]


def head_mask(faces: Faces, size: tuple[int, int], shape: tuple[int, int]) -> Plane:
    """Soft mask of the heads, times their strength: float32, a grid of `shape` over the frame, 0..1.

    Args:
        size: (width, height) of the frame, px.
        shape: (rows, columns) of the grid.
    """
    height, width = shape
    cell = np.float32(size[0] / width), np.float32(size[1] / height)
    plane = np.zeros(shape, np.float32)
    _add_heads(faces["box"].astype(np.float32), faces["strength"].astype(np.float32), cell, plane)
    return plane


@kernel
def _add_heads(
    boxes: NDArray[np.float32], strengths: NDArray[np.float32], cell: tuple[np.float32, np.float32], plane: Plane
) -> None:  # fmt: skip
    """Raise the plane to the masks of the heads. `cell`: width and height of a cell, px."""
    height, width = plane.shape
    squares = np.empty(width, np.float32)
    for k in range(len(boxes)):
        half_x = max(boxes[k, 2] * np.float32(_HALF_WIDTH), np.float32(_LEAST_CELLS) * cell[0])
        half_y = max(boxes[k, 3] * np.float32(_HALF_HEIGHT), np.float32(_LEAST_CELLS) * cell[1])
        raised = boxes[k, 3] * np.float32(_RAISE)
        for x in range(width):
            across = ((np.float32(x) + np.float32(0.5)) * cell[0] - boxes[k, 0]) / half_x
            squares[x] = across * across
        for y in range(height):
            down = ((np.float32(y) + np.float32(0.5)) * cell[1] - boxes[k, 1] + raised) / half_y
            for x in range(width):  # this vectorises
                own = strengths[k] * _soft_edge(np.sqrt(squares[x] + down * down), np.float32(_FADE))
                plane[y, x] = max(plane[y, x], own)
