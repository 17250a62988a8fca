"""The step `scan`: one pass over all inputs. Counts frames, detects cuts, measures tones, checks keyframes and
layers."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import replace
from itertools import pairwise
from typing import cast

from pipeline.errors import BadInput
from pipeline.frames import Frame, Mask
from pipeline.methods.analogy.inputs import SynthesisInputs, key_sources, painted_masks
from pipeline.methods.analogy.job_inputs import JobInputs
from pipeline.methods.analogy.layer_inputs import LayerInputs
from pipeline.methods.analogy.params import AnalogyParams
from pipeline.methods.analogy.plan import MAX_INTERVAL_FRAMES
from pipeline.methods.analogy.shot_layers import (
    Factors,
    Layer,
    LayeredShot,
    LayerStatistics,
    RenderPasses,
    layered_shot,
)
from pipeline.methods.analogy.style_images import save_default_pair
from pipeline.methods.analogy.style_scaling import scaled_style_saved
from pipeline.methods.base import PlanContext, Task, TaskContext, TaskResult
from pipeline.methods.scan import scan_video
from pipeline.synthesis.tone_matching import ToneAccumulator, ToneStatistics, lab_guide
from pipeline.video.passes import Convention, factors_of

TASK = "video"
_SAMPLED_FRAMES = 24
"""Number of evenly spaced frames from which the tones of a layer are measured."""


def plan_scan(context: PlanContext[AnalogyParams]) -> list[Task]:
    """A single task."""
    return [Task(TASK, weight=0.05 * max(context.video.frames, 1))]


def run_scan(task: Task, context: TaskContext[AnalogyParams]) -> TaskResult:
    """Count the frames, detect cuts, and measure the tones of the video and of each layer.

    The result holds the number of frames, the first frame of each shot but the first, the keyframes, (frame number,
    whether it is painted everywhere), their sources, see `key_sources`, and for each layer its name, parameters,
    keyframes, overpaint and a message about its motion vectors.
    """
    shot, video = layered_shot(context), context.video
    accumulator = ToneAccumulator()

    def measure(frame: Frame) -> None:
        accumulator.add(lab_guide(frame))

    first, stop = _scanned(context, shot)
    with nullcontext() if shot is not None else scaled_style_saved(context, JobInputs(context)):
        scanned, cuts = scan_video(
            context, context.params.cut_sensitivity, None if video.is_piece else measure, (first, stop)
        )
        if video.is_piece:
            _sample(context, measure)
    frames = max(scanned, video.total) if video.is_piece else scanned
    tones = accumulator.statistics()
    edges = [first or 0, *cuts, scanned]
    masks = painted_masks(JobInputs(context), frames) if shot is None else {}
    unkeyed = _unkeyed(edges, masks)
    if masks and not context.has("style_output"):
        for begin, end in unkeyed:
            context.warn(
                f"The shot of the frames {begin} to {end - 1} has no painted keyframe: its style is the nearest one."
            )
    elif not context.has("style_output") and unkeyed:
        with context.clock("style"):
            save_default_pair(context, frames)
    if shot is None:
        ranges = JobInputs(context).ranges()
        context.save(JobInputs.statistics_artefact, LayerStatistics(tones, ranges=ranges).arrays())
        return {"first": first or 0, "frames": scanned, "cuts": cuts, **_keys(masks, edges), "layers": []}
    if frames != shot.whole.frames:
        raise BadInput(
            "Some pictures of the shot could not be read.", field="inputs.video", value=f"{frames} of "
            f"{shot.whole.frames}", remedy="Render the others again.",
        )  # fmt: skip
    whole, *layers = [_scan_layer(context, layer, tones, edges) for layer in (shot.whole, *shot.layers)]
    found = {name: whole[name] for name in ("keys", "sources", "message")}
    return {"first": first or 0, "frames": scanned, "cuts": cuts, **found, "layers": layers}


def _unkeyed(edges: Sequence[int], keys: Collection[int]) -> list[tuple[int, int]]:
    """The shots without a keyframe, which need another style."""
    return [(begin, end) for begin, end in pairwise(edges) if not any(begin <= index < end for index in keys)]


def _scanned(context: TaskContext[AnalogyParams], shot: LayeredShot | None) -> tuple[int | None, int | None]:
    """Frames [first, end) of the film that determine the painted frames: between keyframes that are painted everywhere,
    frames depend on those of both, so that the shots are found from the key before a piece to the key after it."""
    video = context.video
    if not video.is_piece:
        return None, None
    inputs: list[SynthesisInputs] = [JobInputs(context)]
    if shot is not None:
        inputs = [LayerInputs(context, layer, None) for layer in (shot.whole, *shot.layers)]
    first, stop = video.first, video.stop
    for masks in (painted_masks(own, video.total) for own in inputs):
        if masks:
            full = [index for index, mask in masks.items() if mask is None]
            first = min(first, max((index for index in full if index <= video.first), default=0))
            most = video.total if len(full) < len(masks) else min(video.total, video.stop + MAX_INTERVAL_FRAMES)
            stop = max(stop, min((index + 1 for index in full if index >= video.stop - 1), default=most))
    return first, stop


def _sample(context: TaskContext[AnalogyParams], measure: Callable[[Frame], None]) -> None:
    """Measure evenly spaced frames of the film, for a piece of it: all of them would cost more than the piece."""
    for index in range(0, context.video.total, max(1, context.video.total // _SAMPLED_FRAMES)):
        for frame in context.frames("video", index, index + 1):
            measure(frame)


def _keys(masks: Mapping[int, Mask | None], edges: Sequence[int]) -> TaskResult:
    """The keyframes, and the sources of those that are partial and of their neighbours."""
    sources: list[tuple[int, list[int], list[int]]] = []
    for first, end in pairwise(edges):
        found = key_sources({index: mask for index, mask in masks.items() if first <= index < end})
        sources += [(index, *both) for index, both in found.items() if max(map(len, both)) > 1]
    return {"keys": [(index, mask is None) for index, mask in masks.items()], "sources": sources}


def _scan_layer(
    context: TaskContext[AnalogyParams], layer: Layer, tones: ToneStatistics, edges: Sequence[int]
) -> TaskResult:
    """Check that every picture of a layer can be read, and determine the sign of its motion vectors."""
    inputs, passes = LayerInputs(context, layer, None), RenderPasses(layer, context.size)
    with context.clock("scan"):
        factors, message = _vector_factors(context, layer, passes)
        _check_settings(layer, passes)
        masks = painted_masks(inputs, layer.frames)
        if masks and not layer.stylised:
            raise BadInput(
                f"{layer.where} has keyframes, but is not stylised.", field=f"shot.json: layers.{layer.name}.stylise",
                value=False, remedy="Remove its keyframes, or remove the setting.",
            )  # fmt: skip
        own = tones if layer.number < 0 else _layer_tones(context, layer, passes)
        statistics = LayerStatistics(own, factors, inputs.overpaint_px())
        statistics = replace(statistics, ranges=LayerInputs(context, layer, None, bool(masks)).ranges())
    with scaled_style_saved(context, LayerInputs(context, layer, statistics)):
        context.save(layer.statistics_artefact, statistics.arrays())
    return {
        "name": layer.name, **_keys(masks, edges), "message": message, "params": layer.params,
        "overpaint_px": statistics.reach_px, "stylised": layer.stylised,
    }  # fmt: skip


def _check_settings(layer: Layer, passes: RenderPasses) -> None:
    """Refuse settings of a layer that have no effect on it.

    Raises:
        BadInput: parameters, guides or overpaint of a layer that is not painted, or overpaint of one without outline.
    """
    settings = layer.files.settings
    if settings is None:
        return
    where, given = f"shot.json: layers.{layer.name}", settings.model_fields_set
    for name in ("params", "guides", "overpaint_px") if not layer.stylised else ():
        if name in given:
            raise BadInput(
                f"{layer.where} is not stylised, so that {name} has no effect.", field=f"{where}.{name}",
                remedy="Remove it, or stylise the layer.",
            )  # fmt: skip
    if settings.overpaint_px and not passes.masked:
        raise BadInput(
            f"{layer.where} covers the whole frame: it has no outline to paint beyond.", field=f"{where}.overpaint_px",
            value=settings.overpaint_px, remedy="Remove it, or give the layer masks, ids or opacity.",
        )  # fmt: skip


def _layer_tones(context: TaskContext[AnalogyParams], layer: Layer, passes: RenderPasses) -> ToneStatistics:
    """Tone statistics of the pixels inside the layer's silhouette."""
    accumulator = ToneAccumulator()
    for index in range(0, layer.frames, max(1, layer.frames // _SAMPLED_FRAMES)):
        accumulator.add(lab_guide(passes.frame(index)), passes.mask(index))
        context.progress(1.0)
    return accumulator.statistics()


def _vector_factors(
    context: TaskContext[AnalogyParams], layer: Layer, passes: RenderPasses
) -> tuple[Factors | None, str]:
    """Sign factors of the motion vectors of a layer (None = no vectors), and a message about them."""
    if layer.frames < 2 or not passes.has_vectors():
        return None, "Motion is estimated by optical flow."
    convention = layer.params.get("vectors") or layer.vectors or context.params.vectors
    if not isinstance(convention, str):
        factors = (float(convention[0]), float(convention[1]), float(convention[2]))
        return factors, "Vectors are multiplied by the factors in shot.json."
    middle = layer.frames // 2 - 1
    pictures = [(passes.vector_image(index), passes.frame(index)) for index in (middle, middle + 1)]
    return factors_of(cast(Convention, convention), pictures[0], pictures[1])
