"""Resampling of a session's state to another frame size, so that the picture does not jump at a change of
resolution."""

from __future__ import annotations

from collections.abc import Mapping

import cv2
import numpy as np

from pipeline.arrays import AnyArray, Arrays, State
from pipeline.methods.abstraction.sizes import Sizes

PICTURES = ("analyzer.gray", "analyzer.denoised")
OUTPUT = "compositor.picture"
LABELS, AREAS, REMAINDER = "regions.segmenter.labels", "regions.segmenter.areas", "regions.segmenter.remainder"
FACES, FRAME_SIZE = "analyzer.importance.faces", "analyzer.frame_size"
FACE_COLUMNS = 8
"""Columns of a stored face in px: smoothed and detected box, (x, y, width, height) each."""
RESPONSE, STROKES, HALF_WIDTHS = "analyzer.lines.response", "analyzer.lines.places", "analyzer.lines.half_widths"
COARSE = ("analyzer.importance.cues", "analyzer.importance.mask", RESPONSE)


def resample_state(state: Arrays, sizes: Sizes, coarse: Mapping[str, tuple[int, int]]) -> State:
    """Resample a state for a session of other sizes.

    Args:
        state: from `AbstractionSession.state`, of any frame size.
        sizes: sizes of the new session.
        coarse: (width, height) of the planes that are coarser than the frame (`COARSE`), by name.

    Regions keep their ids and colours. A region that has no pixel at the new size ends like a region that is covered.
    Motion remainders are reset.
    """
    size = sizes.work
    moved = dict(state)
    faces = np.array(moved[FACES], np.float64)
    faces[:, :FACE_COLUMNS] *= np.tile(np.divide(sizes.frame, state[FRAME_SIZE]), FACE_COLUMNS // 2)
    moved[FACES] = faces
    if OUTPUT in moved:
        moved[OUTPUT] = _resample(moved[OUTPUT], sizes.output)
    for name in COARSE:
        if name in moved and moved[name].size and name in coarse:
            moved[name] = _resample(moved[name], coarse[name])
    if RESPONSE in state and RESPONSE in coarse:
        scale = np.divide(coarse[RESPONSE], state[RESPONSE].shape[1::-1]).astype(np.float32)
        moved[STROKES], moved[HALF_WIDTHS] = state[STROKES] * scale, state[HALF_WIDTHS] * scale.mean()
    before = _size(state)
    if before is None or before == size:
        return moved
    for name in PICTURES:
        if name in moved:
            moved[name] = _resample(moved[name], size)
    if LABELS in moved:
        moved[LABELS] = np.asarray(cv2.resize(moved[LABELS], size, interpolation=cv2.INTER_NEAREST), np.int32)
        counts = np.bincount(moved[LABELS].ravel(), minlength=len(moved[AREAS]))
        moved[AREAS] = counts.astype(np.int32)
        moved[REMAINDER] = np.zeros((size[1], size[0], 2), np.int8)
    return moved


def _size(state: Arrays) -> tuple[int, int] | None:
    """(width, height) of the analysed frames of a state; None before the first frame."""
    gray = state.get("analyzer.gray")
    return None if gray is None else (gray.shape[1], gray.shape[0])


def _resample(plane: AnyArray, size: tuple[int, int]) -> AnyArray:
    if (plane.shape[1], plane.shape[0]) == size:
        return plane
    how = cv2.INTER_AREA if plane.shape[1] > size[0] else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(plane, size, interpolation=how), plane.dtype)
