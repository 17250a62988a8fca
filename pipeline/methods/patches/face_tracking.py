"""Faces: tracked through every shot, as weights of the strokes that keep them recognisable, and widths of the faces.

faces-<run>   faces of the frames of a run; the tasks of a shot form a chain, beside that of the label maps
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import State
from pipeline.frames import Plane
from pipeline.methods.base import Task, TaskContext, TaskResult
from pipeline.methods.patches.face_strokes import FacePlanes
from pipeline.methods.patches.params import PatchesParams
from pipeline.methods.patches.scan import WorkingGrid, run_start
from pipeline.methods.patches.window_flow import WindowFlow
from pipeline.perception.face_masks import head_mask
from pipeline.perception.faces import NO_FACES, Faces, FaceTracker, faces_of_state
from pipeline.perception.flow.gray import Gray

HALF_LIFE_FRAMES = 6.0
"""Half-life with which boxes and strengths of faces follow the detections."""
SEARCHES = 3
"""Pieces of a frame that are searched for new faces; a live session searches one."""
FEATURES = ((-0.19, -0.11, 0.17, 0.12), (0.19, -0.11, 0.17, 0.12), (0.0, 0.27, 0.24, 0.12))
"""Eyes and mouth: centre (x, y) and semi-axes of ellipses, in sides of the box, from its centre."""
FEATURE_WIDTH = 0.25
"""Strokes at eyes and mouth are those of a face this many times as wide."""
FEATURE_TOLERANCE = 0.3
"""Factor on the tolerated error at eyes and mouth: a smaller misfit suffices to replace their paint."""
CELL_PX = 2
"""Cell of the grid on which weights are computed, px of the frame."""


def faces_key(start: int) -> str:
    """Key of the task that tracks the faces of the run that starts at frame `start`."""
    return f"faces-{start:07d}"


def run_faces(task: Task, context: TaskContext[PatchesParams]) -> TaskResult:
    """Track the faces of frames [start, stop), from the state after the frame before them.

    The first frame of each run is searched completely. A live session would find a face that enters the frame later.

    The artefact has the state of the tracker after each frame: "<frame>", float64 (n, ...).
    """
    start, stop, begin = (task.args[name] for name in ("start", "stop", "begin"))
    flow, grid = WindowFlow(context, begin), WorkingGrid.of(context.size)
    tracker = FaceTracker(context.size, HALF_LIFE_FRAMES)
    arrays: State = {}
    if start > begin:
        tracker.restore({"faces": context.load("cluster", faces_key(run_start(start - 1, begin)))[str(start - 1)]})
    for index, frame in enumerate(context.frames("video", start, stop), start=start):
        pair = flow.forward(index - 1) if index > begin else None
        moved = None if pair is None else np.asarray(pair[0] * np.array(grid.ratio, np.float32), np.float32)
        with context.clock("faces"):
            gray, age = np.asarray(cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY), np.uint8), index - begin
            tracker.step(gray, moved, age)
            if index == start > begin:
                tracker.search_whole(gray, strength=1.0)
            for part in range(SEARCHES):
                tracker.search(gray, SEARCHES * age + part)
        arrays[str(index)] = tracker.state()["faces"]
        context.progress((index + 1 - start) / (stop - start))
    context.save(task.key, arrays)
    return {}


class ShotFaces:
    """Reads the faces of a shot that `run_faces` has stored. Safe for several threads.

    Args:
        begin: first frame of the shot.
    """

    def __init__(self, context: TaskContext[PatchesParams], begin: int) -> None:
        self._context, self._begin = context, begin
        self._runs: dict[int, State] = {}

    def __call__(self, index: int) -> FacePlanes | None:
        """The faces of frame `index`, with the weights of strokes on them; None = no faces."""
        faces = self._faces(index)
        return None if not len(faces) else frame_planes(faces, self._context.params.face_detail, self._context.size)

    def tolerance(self, index: int) -> Plane | None:
        """Factor on the tolerated error of paint in frame `index`: float32 (h, w), `FEATURE_TOLERANCE`..1; None = 1."""
        faces, size = self._faces(index), self._context.size
        if not len(faces):
            return None
        coarse = _coarse(size)
        features = np.zeros(coarse, np.float32)
        for face in faces:
            np.maximum(features, np.float32(face["strength"]) * feature_mask(face["box"], size, coarse), out=features)
        lower = np.float32(self._context.params.face_detail * (1 - FEATURE_TOLERANCE))
        return np.asarray(cv2.resize(1 - lower * features, size, interpolation=cv2.INTER_LINEAR), np.float32)

    def _faces(self, index: int) -> Faces:
        if self._context.params.face_detail <= 0:
            return NO_FACES
        start = run_start(index, self._begin)
        runs = self._runs
        if start not in runs:
            self._runs = runs = {start: self._context.load("cluster", faces_key(start))}
        return faces_of_state({"faces": runs[start][str(index)]})


def frame_planes(faces: Faces, detail: float, size: tuple[int, int]) -> FacePlanes:
    """Soft masks of the heads times `detail`, and their widths, computed on a coarser grid.

    Args:
        size: (width, height) of the frame, px.
    """
    coarse = _coarse(size)
    weight, width = np.zeros(coarse, np.float32), np.zeros(coarse, np.float32)
    for index in range(len(faces)):
        own = head_mask(faces[index : index + 1], size, coarse)
        width = np.where(own > weight, stroke_widths(faces["box"][index], size, coarse), width)
        np.maximum(weight, own, out=weight)
    soft = np.asarray(cv2.resize(weight, size, interpolation=cv2.INTER_LINEAR), np.float32)
    return FacePlanes(
        np.float32(detail) * soft, np.asarray(cv2.resize(width, size, interpolation=cv2.INTER_NEAREST), np.float32)
    )


def stroke_widths(box: NDArray[np.float64], size: tuple[int, int], shape: tuple[int, int]) -> Plane:
    """Width of a face in px, `FEATURE_WIDTH` times as much at eyes and mouth: float32, a grid of `shape`.

    Args: as for `feature_mask`.
    """
    narrower = np.float32(1 - FEATURE_WIDTH) * feature_mask(box, size, shape)
    return np.asarray(np.float32(box[2]) * (1 - narrower), np.float32)


def feature_mask(box: NDArray[np.float64], size: tuple[int, int], shape: tuple[int, int]) -> Plane:
    """Soft mask of the eyes and the mouth of a face: float32, a grid of `shape`, 0..1.

    Args:
        box: float64 (4,), (centre x, centre y, width, height) of the face, px.
        size: (width, height) of the frame, px.
        shape: (rows, columns) of the grid.
    """
    x = ((np.arange(shape[1], dtype=np.float32) + 0.5) * np.float32(size[0] / shape[1]) - np.float32(box[0]))[None, :]
    y = ((np.arange(shape[0], dtype=np.float32) + 0.5) * np.float32(size[1] / shape[0]) - np.float32(box[1]))[:, None]
    nearest = np.full(shape, np.float32(np.inf))
    for across, down, half_x, half_y in FEATURES:
        far_x, far_y = x / np.float32(box[2]) - np.float32(across), y / np.float32(box[3]) - np.float32(down)
        np.minimum(nearest, (far_x / np.float32(half_x)) ** 2 + (far_y / np.float32(half_y)) ** 2, out=nearest)
    return np.asarray(np.clip(2 - nearest, 0, 1), np.float32)


def _coarse(size: tuple[int, int]) -> tuple[int, int]:
    """(rows, columns) of the grid of `CELL_PX` cells over a frame of `size`, (width, height)."""
    return max(1, size[1] // CELL_PX), max(1, size[0] // CELL_PX)


def single_frame_planes(gray: Gray, detail: float) -> FacePlanes | None:
    """The faces of a frame on its own, with the weights of strokes on them; None = no faces."""
    if detail <= 0:
        return None
    size = gray.shape[1], gray.shape[0]
    tracker = FaceTracker(size, HALF_LIFE_FRAMES)
    tracker.step(gray, None, 0)
    return None if not len(tracker.faces) else frame_planes(tracker.faces, detail, size)
