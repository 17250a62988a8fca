"""Face detection with OpenCV's cascades (viola2001rapid): frontal, profile and tilted faces, in pieces of equal cost.

A complete search takes longer than a live frame, so that it is divided into pieces: a range of window sizes in a band
of rows. A hit of a piece is only a candidate; `FaceDetector.confirm` searches its surroundings in fine steps, and
`FaceDetector.agrees` asks a second frontal cascade, which was trained with other features on other faces: the
patterns in grass, folds and walls that look like a face to one of the two are rarely the same.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise, zip_longest
from pathlib import Path
from typing import Literal, NamedTuple

import cv2
import numpy as np
from cv2.data import haarcascades
from numpy.typing import NDArray

from pipeline.errors import DeviceError
from pipeline.perception.flow.gray import Gray

Boxes = NDArray[np.float64]
"""(n, 4): centre x, centre y, width, height, px of the picture."""
Pose = Literal["frontal", "left", "right", "tilted left", "tilted right"]
"""Pose of a head. The profile cascade knows one side; the other side is searched in the mirrored picture."""

POSES: tuple[Pose, ...] = ("frontal", "left", "right", "tilted left", "tilted right")
PROFILES = ("left", "right")


@dataclass(frozen=True)
class DetectionParams:
    """Constants of face detection."""

    window_px: int = 24
    """Side of the frontal cascade's smallest window."""
    coarse_step: float = 1.2
    fine_step: float = 1.1
    """Ratio of consecutive window sizes in a search of the whole frame and in `confirm`."""
    least_hits: int = 2
    """Number of windows at one place that the cascade must accept before `confirm` or `agrees` calls it a face."""
    profile_hits: int = 5
    """`least_hits` of a new face in profile, for which there is no second cascade."""
    group_eps: float = 0.2
    """Tolerance of grouping, as in OpenCV."""
    nearby: float = 0.85
    """Half of the side of the square that `confirm` searches, in sides of the face."""
    tilt_degrees: float = 25.0
    least_other: float = 2.0
    """Smallest turned or tilted face that is searched, relative to the smallest frontal one: a quarter of the cost."""
    large: float = 4.0
    large_repeats: int = 4
    """Frontal faces of this size, relative to the smallest, are searched this often in a search: they cost little."""


DETECTION = DetectionParams()


_CASCADES = {
    "frontal": "haarcascade_frontalface_default.xml", "second": "haarcascade_frontalface_alt2.xml",
    "profile": "haarcascade_profileface.xml",
}  # fmt: skip
_WINDOW_COST = {"frontal": 1.0, "left": 2.0, "right": 2.0, "tilted left": 1.3, "tilted right": 1.3}
"""Cost of testing a window, relative to the frontal cascade's."""
_idle: dict[str, list[cv2.CascadeClassifier]] = {kind: [] for kind in _CASCADES}
"""Cascades that no search uses at present. Only one search at a time may use one."""


class Piece(NamedTuple):
    """A part of a search: windows of `least` to `most` px in rows [top, bottom) of the picture as turned for `pose`."""

    pose: Pose
    least: int
    most: int
    top: int
    bottom: int


NO_HITS = np.empty((0, 4), np.int32)


class FaceDetector:
    """Face detector. Its cascades are read from disk on first use and shared by all detectors of the process."""

    def candidates(self, gray: Gray, piece: Piece) -> Boxes:
        """Groups of the windows that the cascade accepts, the largest groups first.

        Args:
            gray: uint8 (h, w), the whole picture.
        """
        boxes, counts = _group(self._hits(gray, piece, DETECTION.coarse_step, _kind(piece.pose)), 0)
        return boxes[np.argsort(-counts, kind="stable")]

    def candidates_in(self, gray: Gray, where: tuple[int, int, int, int], least: int, most: int) -> Boxes:
        """`candidates` of frontal faces of `least` to `most` px in a part of the picture.

        Args:
            where: left, top, right (exclusive), bottom (exclusive), px.
        """
        left, top, right, bottom = where
        window = np.ascontiguousarray(gray[top:bottom, left:right])
        if min(window.shape) < least:
            return np.empty((0, 4))
        boxes = self.candidates(window, Piece("frontal", least, most, 0, len(window)))
        boxes[:, :2] += left, top
        return boxes

    def confirm(
        self, gray: Gray, box: NDArray[np.float64], pose: Pose = "frontal", least_hits: int = DETECTION.least_hits
    ) -> NDArray[np.float64] | None:
        """The face at about the place and of about the size of `box`, (4,), in px; None = there is none.

        Args:
            least_hits: see `DETECTION.least_hits`; more where a false face would do harm.
        """
        return self._found(gray, box, pose, least_hits, _kind(pose))

    def agrees(self, gray: Gray, box: NDArray[np.float64], pose: Pose) -> bool:
        """Whether the second cascade finds the face `box`, (4,), too; True in profile, which it does not know."""
        return pose in PROFILES or self._found(gray, box, pose, DETECTION.least_hits, "second") is not None

    def _found(
        self, gray: Gray, box: NDArray[np.float64], pose: Pose, least_hits: int, kind: str
    ) -> NDArray[np.float64] | None:
        """`confirm` with the cascade of that kind."""
        cx, cy, side = float(box[0]), float(box[1]), float(max(box[2:]))
        reach = side * DETECTION.nearby
        left, top = max(0, int(cx - reach)), max(0, int(cy - reach))
        window = gray[top : int(cy + reach) + 1, left : int(cx + reach) + 1]
        least = round(max(DETECTION.window_px, side * 0.8))
        if min(window.shape) < least:
            return None
        piece = Piece(pose, least, math.ceil(side * 1.3), 0, len(window))
        boxes, _ = _group(self._hits(window, piece, DETECTION.fine_step, kind), least_hits - 1)
        boxes[:, :2] += left, top
        apart = np.linalg.norm(boxes[:, :2] - box[:2], axis=1)
        return boxes[apart.argmin()] if len(boxes) and apart.min() < side / 2 else None

    def _hits(self, gray: Gray, piece: Piece, step: float, kind: str) -> NDArray[np.int32]:
        """Windows that the cascade accepts, int32 (n, 4): left, top, width, height in px, in sorted order."""
        turned, back = _posed(gray, piece.pose)
        # Set per thread. Otherwise the cascade opens the system's OpenCL loader, which then hides the registered
        # runtimes.
        cv2.ocl.setUseOpenCL(False)
        least, most = (piece.least, piece.least), (piece.most, piece.most)
        with _cascade(kind) as cascade:
            found = cascade.detectMultiScale(turned[piece.top : piece.bottom], step, 0, minSize=least, maxSize=most)
        if not len(found):
            return NO_HITS
        hits = np.array(found, np.float64)
        centres = (hits[:, :2] + hits[:, 2:] / 2 + (0, piece.top)) @ back[:, :2].T + back[:, 2]
        hits[:, :2] = centres - hits[:, 2:] / 2
        return np.array(sorted(map(tuple, np.rint(hits).astype(np.int32))), np.int32)


def pieces(size: tuple[int, int], least_px: int, count: int) -> list[Piece]:
    """A search of all poses in `count` pieces or a few more, each of about the same cost, frontal ones in between.

    Large frontal faces are searched several times.

    Args:
        size: (width, height) of the picture, px.
        least_px: smallest frontal face.
    """
    other = round(least_px * DETECTION.least_other)
    cost = [_WINDOW_COST[pose] * _windows_from(size, least_px if pose == "frontal" else other) for pose in POSES]
    budget = sum(cost) / max(1, count)
    every = pose_pieces(size, "frontal", least_px, budget)
    large, small = _parted(every, round(DETECTION.large * least_px))
    step = max(1, math.ceil(len(small) / DETECTION.large_repeats))
    frontal = [piece for k in range(0, max(1, len(small)), step) for piece in (*large, *small[k : k + step])]
    others = [piece for pose in POSES[1:] for piece in pose_pieces(size, pose, other, budget)]
    mixed = zip_longest(frontal, others)
    return [piece for pair in mixed for piece in pair if piece is not None]


def pose_pieces(size: tuple[int, int], pose: Pose, least_px: int, budget: float = math.inf) -> list[Piece]:
    """A search of one pose, in pieces of about the cost `budget`, 1 = a frontal window; large faces come first."""
    found: list[Piece] = []
    waiting: list[int] = []
    left = budget
    for side in reversed(_sizes(least_px, min(size))):
        cost = _WINDOW_COST[pose] * _windows(size, side)
        if waiting and cost > left:
            found.append(Piece(pose, waiting[-1], waiting[0], 0, size[1]))
            waiting, left = [], budget
        if cost <= budget:
            waiting.append(side)
            left -= cost
            continue
        bands = min(math.ceil(cost / budget), max(1, (size[1] - side) // 4))
        edges = np.linspace(0, size[1] - side, bands + 1).astype(int)
        found += [Piece(pose, side, side, int(a), int(b) + side) for a, b in pairwise(edges)]
    return found + ([Piece(pose, waiting[-1], waiting[0], 0, size[1])] if waiting else [])


def _parted(every: list[Piece], least_px: int) -> tuple[list[Piece], list[Piece]]:
    """Pieces of faces from `least_px` on, and the others."""
    return [p for p in every if p.least >= least_px], [p for p in every if p.least < least_px]


def _windows_from(size: tuple[int, int], least_px: int) -> float:
    """Number of windows of all sizes."""
    return sum(_windows(size, side) for side in _sizes(least_px, min(size)))


def _windows(size: tuple[int, int], side: int) -> float:
    """Number of windows of a size; OpenCV tests every second position of the picture scaled to the cascade."""
    return size[0] * size[1] * (DETECTION.window_px / side) ** 2 / 4


def _sizes(least_px: int, most_px: int) -> list[int]:
    """Window sizes that OpenCV tests, px, of at least `least_px` and at most `most_px`."""
    count = int(math.log(max(most_px / DETECTION.window_px, 1)) / math.log(DETECTION.coarse_step)) + 2
    sizes = [round(DETECTION.window_px * DETECTION.coarse_step**k) for k in range(count)]
    return [side for side in sizes if least_px <= side <= most_px]


def _kind(pose: Pose) -> str:
    """The cascade that searches heads of that pose."""
    return "profile" if pose in PROFILES else "frontal"


def _posed(gray: Gray, pose: Pose) -> tuple[Gray, NDArray[np.float64]]:
    """The picture in which the cascade finds heads of that pose, and the affine map (2, 3) back from it."""
    height, width = gray.shape
    if pose == "right":
        return np.ascontiguousarray(gray[:, ::-1]), np.array([[-1.0, 0, width], [0, 1, 0]])
    if pose in ("tilted left", "tilted right"):
        degrees = -DETECTION.tilt_degrees if pose == "tilted left" else DETECTION.tilt_degrees
        matrix = cv2.getRotationMatrix2D((width / 2, height / 2), degrees, 1)
        turned = cv2.warpAffine(gray, matrix, (width, height), borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(turned, np.uint8), np.asarray(cv2.invertAffineTransform(matrix))
    return gray, np.array([[1.0, 0, 0], [0, 1, 0]])


def _group(hits: NDArray[np.int32], least: int) -> tuple[Boxes, NDArray[np.int64]]:
    """Overlapping hits as one box each, and their numbers; groups of at most `least` hits are left out."""
    if not len(hits):
        return np.empty((0, 4)), np.empty(0, np.int64)
    rows = [tuple(int(v) for v in hit) for hit in hits]
    if least == 0:  # OpenCV does not group then
        rows, least = 2 * rows, 1
    found, counts = cv2.groupRectangles(rows, least, DETECTION.group_eps)  # empty tuples if no group is large enough
    boxes = np.array(found, np.float64).reshape(-1, 4)
    boxes[:, :2] += boxes[:, 2:] / 2
    order = np.lexsort(boxes.T)
    return boxes[order], np.array(counts, np.int64).reshape(-1)[order]


@contextmanager
def _cascade(kind: str) -> Iterator[cv2.CascadeClassifier]:
    """A cascade for one search. After an error it is not used again. Raises DeviceError."""
    idle = _idle[kind]
    try:
        cascade = idle.pop()
    except IndexError:
        cascade = _load_cascade(kind)
    yield cascade
    idle.append(cascade)


def _load_cascade(kind: str) -> cv2.CascadeClassifier:
    path = Path(haarcascades) / _CASCADES[kind]
    cascade = cv2.CascadeClassifier(str(path))
    if cascade.empty():
        raise DeviceError(
            "OpenCV's face cascade cannot be read.",
            field="opencv",
            value=path,
            remedy="Install opencv-contrib-python-headless 4.x.",
        )
    return cascade
