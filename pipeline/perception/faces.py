"""Face tracking: detection spread over frames (viola2001rapid) and motion in between.

A complete search costs more than the rest of a frame, and a detector's boxes jitter and drop out. The first frame of a
shot is searched completely for frontal faces. Every later frame (in small ones every fourth, with larger pieces)
searches one piece of the frame for new faces, so that all pieces are searched in a cycle; every second frame searches
the surroundings of one known face. In between, a face moves with the median flow inside its box. Its box follows the
latest detection gradually, and its strength rises and falls gradually.

A candidate becomes a face if a fine search of its surroundings confirms it; the more often that happens again, the
longer the face is kept without a detection. A pattern that looks like a face in one frame is soon removed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Arrays, State
from pipeline.frames import Flow
from pipeline.perception.face_detector import DETECTION, POSES, PROFILES, FaceDetector, Pose, pieces, pose_pieces
from pipeline.perception.face_search_order import PLACES, NewPlaces
from pipeline.perception.flow.gray import Gray
from pipeline.perception.motion import median_motion

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


@dataclass(frozen=True)
class TrackingParams:
    """Constants of face tracking. Lengths are px of the frame unless stated otherwise."""

    cycle_frames: int = 160
    piece_windows: float = 4000.0
    """Frames of a complete search of all poses, and windows of a piece above which it takes longer instead."""
    most_apart: int = 4
    """Most frames from one searched piece to the next. Below `piece_windows`, a piece of fewer windows costs hardly
    less, so small frames are searched in fewer and larger pieces."""
    smallest_share: float = 1 / 48
    """Smallest face, as a fraction of the frame's longer side; at least the detector's window."""
    recheck_frames: int = 8
    """Frames between two searches around a known face, if no other face has waited for longer."""
    first_recheck_frames: int = 4
    """The same after the first detection, which may be false."""
    recheck_widths: float = 72.0
    """Sum of the widths, px, of the faces whose surroundings are searched in a frame."""
    most_candidates: int = 3
    """Candidates of a frame that are looked at closely."""
    least_misses: int = 2
    most_misses: int = 6
    """Limits of the number of searches without detection after which a face is dropped; in between, it equals the
    number of its detections."""


TRACKING = TrackingParams()


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
        least = max(DETECTION.window_px, round(max(size) * TRACKING.smallest_share))
        windows = size[0] * size[1] * (DETECTION.window_px / least) ** 2
        # All window sizes and poses together test about 1.6 times as many windows as the unscaled picture has pixels.
        least_pieces = 1.6 * windows / TRACKING.piece_windows
        self._apart = min(max(1, round(TRACKING.cycle_frames / least_pieces)), TRACKING.most_apart)
        self._pieces = pieces(size, least, max(TRACKING.cycle_frames // self._apart, round(least_pieces)))
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
            self._add_new(gray, self._finder.candidates(gray, piece)[: TRACKING.most_candidates], piece.pose)
        self._search_new(gray, age)
        self._recheck_due(gray, age)

    def _recheck_due(self, gray: Gray, age: int) -> None:
        """Search around the known faces that have waited for longest: several small ones, or in every second frame one
        large one."""
        budget = TRACKING.recheck_widths
        for index in np.argsort(-self.faces["unchecked"], kind="stable"):
            face = self.faces[index]
            wait = TRACKING.recheck_frames if face["detections"] > 1 else TRACKING.first_recheck_frames
            width = float(face["detected"][2])
            if face["unchecked"] < wait or (width > budget and (not age % 2 or budget < TRACKING.recheck_widths)):
                continue
            self._recheck(gray, int(index))
            budget -= width

    def _search_new(self, gray: Gray, age: int) -> None:
        """Search a place that has come into view, or in which something moves."""
        where = self._new.next_rectangle(age)
        if where is None:
            return
        self._add_new(
            gray, self._finder.candidates_in(gray, where, self._least, round(PLACES.largest * self._least)), "frontal"
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
            hits = DETECTION.profile_hits if pose in PROFILES else DETECTION.least_hits
            box = self._finder.confirm(gray, candidate, pose, hits)
            if box is not None and self._known(box) is None and self._finder.agrees(gray, box, pose):
                face = np.array([(box, box, strength, 1.0, 0.0, 0.0, POSES.index(pose))], FACE)
                self.faces = np.concatenate([self.faces, face])

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
        current = faces["misses"] < np.clip(faces["detections"], TRACKING.least_misses, TRACKING.most_misses)
        faces["box"] += self._gain * (faces["detected"] - faces["box"])
        faces["strength"] += self._gain * (current - faces["strength"])
        inside = ((centres >= 0) & (centres < self._size)).all(axis=1)
        self.faces = faces[(current | (faces["strength"] > 0.02)) & inside]


def faces_of_state(state: Arrays) -> Faces:
    """The faces in the state of a tracker."""
    return np.array(state["faces"], np.float64).view(FACE)[:, 0]
