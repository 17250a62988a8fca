"""The step `scan`: one pass over all inputs. Counts frames, detects cuts, measures tones, checks keyframes and
layers."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import asdict, replace
from itertools import pairwise

from pipeline.errors import BadInput
from pipeline.frames import Frame, Mask
from pipeline.methods.analogy.frame_passes import MADE
from pipeline.methods.analogy.inputs import SynthesisInputs, key_sources, painted_masks
from pipeline.methods.analogy.job_inputs import JobInputs
from pipeline.methods.analogy.key_intervals import MAX_INTERVAL_FRAMES, gaps
from pipeline.methods.analogy.key_settings import Settings, reaching
from pipeline.methods.analogy.layer_composite import LAYERS
from pipeline.methods.analogy.layer_inputs import LayerInputs
from pipeline.methods.analogy.params import AnalogyParams
from pipeline.methods.analogy.render_passes import RenderPasses
from pipeline.methods.analogy.shot_layers import (
    Layer,
    LayeredShot,
    LayerStatistics,
    layered_shot,
)
from pipeline.methods.analogy.style_images import save_default_pair
from pipeline.methods.analogy.style_scaling import scaled_style_saved
from pipeline.methods.base import PlanContext, Task, TaskContext, TaskResult
from pipeline.methods.holds import first_scanned
from pipeline.methods.scan import scan_video
from pipeline.passes.facts import known_vectors
from pipeline.passes.sequence import OFF
from pipeline.passes.vectors import VectorFacts, vector_facts
from pipeline.synthesis.tone_matching import ToneAccumulator, ToneStatistics, lab_guide
from pipeline.video.sequence_options import USUAL

TASK = "video"
_ESTIMATED = "Motion is estimated by optical flow."
_SAMPLED_FRAMES = 24
"""Number of evenly spaced frames from which the tones of a layer are measured."""


def plan_scan(context: PlanContext[AnalogyParams]) -> list[Task]:
    """A single task."""
    return [Task(TASK, weight=0.05 * max(context.video.frames, 1))]


def run_scan(task: Task, context: TaskContext[AnalogyParams]) -> TaskResult:
    """Count the frames, detect cuts, and measure the tones of the video and of each layer.

    The result holds the number of frames, the first frame of each shot but the first, the keyframes, (frame number,
    whether it is painted everywhere), their sources, see `key_sources`, their reach and weight, and for each layer its
    name, parameters, keyframes, overpaint and a message about its motion vectors.
    """
    shot, video = layered_shot(context), context.video
    if shot is not None and shot.layers and (lost := [one.name for one in MADE if context.wants_pass(one.name)]):
        context.warn(f"A shot with layers has no passes ({', '.join(lost)}): the artefact {LAYERS} has its layers.")
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
    settings = JobInputs(context).key_settings if shot is None else {}
    if not context.has("style_output") and _needs_default_style(context, edges, masks, settings):
        with context.clock("style"):
            save_default_pair(context, frames)
    if shot is None:
        ranges = JobInputs(context).ranges()
        context.save(JobInputs.statistics_artefact, LayerStatistics(tones, ranges=ranges).arrays())
        found = _keys(masks, edges) | {"settings": [(index, asdict(one)) for index, one in sorted(settings.items())]}
        return {"first": first or 0, "frames": scanned, "cuts": cuts, **found, "layers": []}
    if frames != shot.whole.frames:
        raise BadInput(
            "Some pictures of the shot could not be read.", field="inputs.video", value=f"{frames} of "
            f"{shot.whole.frames}", remedy="Render the others again.",
        )  # fmt: skip
    whole, *layers = [_scan_layer(context, layer, tones, edges) for layer in (shot.whole, *shot.layers)]
    found = {name: whole[name] for name in ("keys", "sources", "message")}
    return {"first": first or 0, "frames": scanned, "cuts": cuts, **found, "layers": layers}


def _needs_default_style(
    context: TaskContext[AnalogyParams], edges: Sequence[int], keys: Collection[int], settings: Settings
) -> bool:
    """Whether the result has frames that no keyframe reaches. Warns of shots that have the style of another shot's."""
    found, video = False, context.video
    for begin, end in pairwise(edges):
        if not video.delivers_any(begin, end):
            continue
        own = [index for index in keys if begin <= index < end]
        if own:
            found |= any(video.delivers_any(*run) for run in gaps(begin, end, own, settings))
        elif reaching(begin, keys, settings):
            context.warn(
                f"The shot of the frames {begin} to {end - 1} has no painted keyframe: its style is the nearest one."
            )
        else:
            found = True
    return found


def _scanned(context: TaskContext[AnalogyParams], shot: LayeredShot | None) -> tuple[int | None, int | None]:
    """Frames [first, end) of the film that determine the painted frames: between keyframes that are painted everywhere,
    frames depend on those of both, so that the shots are found from the key before a piece to the key after it. See
    also `first_scanned`."""
    video = context.video
    if not video.is_piece:
        return None, None
    inputs: list[SynthesisInputs] = [JobInputs(context)]
    if shot is not None:
        inputs = [LayerInputs(context, layer, None) for layer in (shot.whole, *shot.layers)]
    first = first_scanned(video, max(own.params.frames_per_painting for own in inputs))
    stop = video.stop
    for masks in (painted_masks(own, video.total) for own in inputs):
        if masks:
            full = [index for index, mask in masks.items() if mask is None]
            first = min(first, max((index for index in full if index <= video.first), default=0))
            limited = len(full) < len(masks) or any(one.key_settings for one in inputs if isinstance(one, JobInputs))
            most = video.total if limited else min(video.total, video.stop + MAX_INTERVAL_FRAMES)
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
        vectors, message = _vector_facts(context, layer, passes)
        _check_settings(layer, passes)
        masks = painted_masks(inputs, layer.frames)
        if masks and not layer.stylised:
            raise BadInput(
                f"{layer.where} has keyframes, but is not stylised.", field=f"shot.json: layers.{layer.name}.stylise",
                value=False, remedy="Remove its keyframes, or remove the setting.",
            )  # fmt: skip
        own = tones if layer.number < 0 else _layer_tones(context, layer, passes)
        statistics = LayerStatistics(own, reach_px=inputs.overpaint_px())
        if vectors is not None:
            statistics = replace(statistics, factors=vectors.factors, way=vectors.way)
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


def _vector_facts(
    context: TaskContext[AnalogyParams], layer: Layer, passes: RenderPasses
) -> tuple[VectorFacts | None, str]:  # fmt: skip
    """What is known about the motion vectors of a layer (None = none are used), and a message about them."""
    read = getattr(layer.contents, "options", USUAL).vectors
    of_sequence = None if read == USUAL.vectors else read
    stated = layer.params.get("vectors") or of_sequence or layer.vectors or context.params.vectors
    if stated == OFF or layer.frames < 2 or not passes.has_vectors():
        return None, _ESTIMATED
    if layer.number < 0 and context.params.vectors == "auto" and context.pass_facts:
        found = known_vectors(context.pass_facts)
        return (
            found if found is not None and found.used else None
        ), found.sentence() if found is not None else _ESTIMATED
    middle = layer.frames // 2 - 1
    first, second = ((passes.vector_image(index), passes.stored_frame(index)) for index in (middle, middle + 1))
    facts = vector_facts(first, second, stated, passes.where(first[0]))
    return (facts if facts.used else None), facts.sentence()
