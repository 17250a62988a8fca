"""The step `scan`: one pass over all inputs. Counts frames, detects cuts, measures tones, checks keyframes and
layers."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from itertools import pairwise
from typing import cast

from pipeline.errors import BadInput
from pipeline.frames import Frame
from pipeline.methods.analogy.inputs import SynthesisInputs, checked_keyframes
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

    The result holds the number of frames, the first frame of each shot but the first, the keyframes, see
    `checked_keyframes`, and for each layer its name, keyframes, overpaint and a message about its motion vectors.
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
    keys = checked_keyframes(JobInputs(context), frames) if shot is None else []
    unkeyed = _unkeyed([first or 0, *cuts, scanned], keys)
    if keys and not context.has("style_output"):
        for begin, end in unkeyed:
            context.warn(
                f"The shot of the frames {begin} to {end - 1} has no painted keyframe: its style is the nearest one."
            )
    elif not context.has("style_output") and unkeyed:
        with context.clock("style"):
            save_default_pair(context, frames)
    if shot is None:
        context.save("tones", LayerStatistics(tones).arrays())
        return {"first": first or 0, "frames": scanned, "cuts": cuts, "keys": keys, "layers": []}
    if frames != shot.whole.frames:
        raise BadInput(
            "Some pictures of the shot could not be read.", field="inputs.video", value=f"{frames} of "
            f"{shot.whole.frames}", remedy="Render the others again.",
        )  # fmt: skip
    whole, *layers = [_scan_layer(context, layer, tones) for layer in (shot.whole, *shot.layers)]
    found = {"first": first or 0, "frames": scanned, "cuts": cuts, "keys": whole["keys"]}
    return found | {"message": whole["message"], "layers": layers}


def _unkeyed(edges: list[int], keys: list[tuple[int, bool]]) -> list[tuple[int, int]]:
    """The shots without a keyframe, which need another style."""
    return [(begin, end) for begin, end in pairwise(edges) if not any(begin <= index < end for index, _ in keys)]


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
    for keys in (checked_keyframes(own, video.total) for own in inputs):
        if keys:
            full = [index for index, whole in keys if whole]
            first = min(first, max((index for index in full if index <= video.first), default=0))
            most = min(video.total, video.stop + MAX_INTERVAL_FRAMES)
            stop = max(stop, min((index + 1 for index in full if index >= video.stop - 1), default=most))
    return first, stop


def _sample(context: TaskContext[AnalogyParams], measure: Callable[[Frame], None]) -> None:
    """Measure evenly spaced frames of the film, for a piece of it: all of them would cost more than the piece."""
    for index in range(0, context.video.total, max(1, context.video.total // _SAMPLED_FRAMES)):
        for frame in context.frames("video", index, index + 1):
            measure(frame)


def _scan_layer(context: TaskContext[AnalogyParams], layer: Layer, tones: ToneStatistics) -> TaskResult:
    """Check that every picture of a layer can be read, and determine the sign of its motion vectors."""
    inputs, passes = LayerInputs(context, layer, None), RenderPasses(layer, context.size)
    with context.clock("scan"):
        factors, message = _vector_factors(context, layer, passes)
        keys = checked_keyframes(inputs, layer.frames)
        if keys and not layer.stylised:
            raise BadInput(
                f"{layer.where} has keyframes, but is not stylised.", field=f"shot.json: layers.{layer.name}.stylise",
                value=False, remedy="Remove its keyframes, or remove the setting.",
            )  # fmt: skip
        own = tones if layer.number < 0 else _layer_tones(context, layer, passes)
        statistics = LayerStatistics(own, factors, inputs.overpaint_px())
    LayerInputs(context, layer, statistics, keyframe_style=bool(keys)).guides  # noqa: B018  (raises for invalid guides)
    with scaled_style_saved(context, LayerInputs(context, layer, statistics)):
        context.save(layer.statistics_artefact, statistics.arrays())
    return {
        "name": layer.name, "keys": keys, "message": message, "overpaint_px": statistics.reach_px,
        "stylised": layer.stylised,
    }  # fmt: skip


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
    convention = layer.vectors or context.params.vectors
    if not isinstance(convention, str):
        factors = (float(convention[0]), float(convention[1]), float(convention[2]))
        return factors, "Vectors are multiplied by the factors in shot.json."
    middle = layer.frames // 2 - 1
    pictures = [(passes.vector_image(index), passes.frame(index)) for index in (middle, middle + 1)]
    return factors_of(cast(Convention, convention), pictures[0], pictures[1])
