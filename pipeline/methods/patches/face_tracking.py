"""Faces: tracked through every shot, as weights of the fine strokes that keep them recognisable.

    faces-<run>   faces of the frames of a run; the tasks of a shot form a chain, beside that of the label maps

Departure: zhang2011patches treats faces like everything else. With the strokes of its table 1, the eyes of a face 30 px
wide are covered by single strokes.
"""

from __future__ import annotations

import cv2
import numpy as np

from pipeline.arrays import State
from pipeline.frames import Plane
from pipeline.methods.base import Task, TaskContext, TaskResult
from pipeline.methods.patches.params import PatchesParams
from pipeline.methods.patches.scan import WorkingGrid, run_start
from pipeline.methods.patches.window_flow import WindowFlow
from pipeline.segmentation.face_detector import Gray
from pipeline.segmentation.faces import Faces, FaceTracker, faces_of_state, head_mask

HALF_LIFE_FRAMES = 6.0
"""Half-life with which boxes and strengths of faces follow the detections."""
SEARCHES = 3
"""Pieces of a frame that are searched for new faces; a live session searches one."""
CELL_PX = 2
"""Cell of the grid on which weights are computed, px of the frame."""


def faces_key(start: int) -> str:
    """Key of the task that tracks the faces of the run that starts at frame `start`."""
    return f"faces-{start:07d}"


def run_faces(task: Task, context: TaskContext[PatchesParams]) -> TaskResult:
    """Track the faces of frames [start, stop), from the state after the frame before them.

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
            for part in range(SEARCHES):
                tracker.search(gray, SEARCHES * age + part)
        arrays[str(index)] = tracker.state()["faces"]
        context.progress((index + 1 - start) / (stop - start))
    context.save(task.key, arrays)
    return {}


class FaceWeights:
    """Reads the faces of a shot that `run_faces` has stored.

    Args:
        begin: first frame of the shot.
    """

    def __init__(self, context: TaskContext[PatchesParams], begin: int) -> None:
        self._context, self._begin = context, begin
        self._runs: dict[int, State] = {}

    def __call__(self, index: int) -> Plane | None:
        """Weight of the fine strokes in frame `index`: float32 (h, w), 0..1; None = 0 everywhere."""
        detail = np.float32(self._context.params.face_detail)
        if detail <= 0:
            return None
        start = run_start(index, self._begin)
        if start not in self._runs:
            self._runs = {start: self._context.load("cluster", faces_key(start))}
        faces = faces_of_state({"faces": self._runs[start][str(index)]})
        return None if not len(faces) else detail * frame_weights(faces, self._context.size)


def frame_weights(faces: Faces, size: tuple[int, int]) -> Plane:
    """Soft mask of the heads, float32 (h, w), 0..1, computed on a coarser grid.

    Args:
        size: (width, height) of the frame, px.
    """
    coarse = max(1, size[1] // CELL_PX), max(1, size[0] // CELL_PX)
    return np.asarray(cv2.resize(head_mask(faces, size, coarse), size, interpolation=cv2.INTER_LINEAR), np.float32)


def single_frame_weights(gray: Gray, detail: float) -> Plane | None:
    """Weight of the fine strokes in a frame on its own: float32 (h, w), 0..1; None = 0 everywhere."""
    if detail <= 0:
        return None
    size = gray.shape[1], gray.shape[0]
    tracker = FaceTracker(size, HALF_LIFE_FRAMES)
    tracker.step(gray, None, 0)
    return None if not len(tracker.faces) else np.float32(detail) * frame_weights(tracker.faces, size)
