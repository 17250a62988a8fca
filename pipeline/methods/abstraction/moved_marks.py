"""The user's importance in a frame as the film has it there: a drawing moves with the picture."""

from __future__ import annotations

from pipeline.arrays import AnyArray
from pipeline.frames import Frame, Plane
from pipeline.kernels.executors import INLINE
from pipeline.methods.abstraction.analysis import FrameAnalyzer
from pipeline.methods.abstraction.params import AbstractionParams
from pipeline.methods.abstraction.sizes import resize_flow, sizes_of
from pipeline.methods.masks import drawn_plane, fitted
from pipeline.methods.tasks import no_clock
from pipeline.perception.cuts import is_cut, thumbnail


def move_marks(
    params: AbstractionParams, marks: Plane | None, before: Frame, frame: Frame, drawn: AnyArray | None
) -> Plane | None:
    """See `pipeline.methods.base.Method.move_marks`."""
    height, width = frame.shape[:2]
    analyzer = FrameAnalyzer(params, sizes_of(params, (width, height)), False, 0, no_clock, INLINE)
    importance = analyzer.importance
    if drawn is not None:
        return importance.move_mask(None, fitted(drawn_plane(drawn), (width, height), "importance"), None)
    if marks is None or (marks[..., 1] >= 1).all():
        return marks  # a mask of the whole frame holds until the next one, also after a cut
    if is_cut(thumbnail(before), thumbnail(frame), params.cut_sensitivity):
        return None
    flow = analyzer.flow(analyzer.smoothed(before).gray, analyzer.smoothed(frame).gray)
    coarse = None if flow is None else resize_flow(flow, importance.map_size, analyzer.sizes)
    return importance.move_mask(marks, None, coarse)
