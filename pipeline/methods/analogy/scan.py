"""The step `scan`: one pass over all inputs. Counts frames, detects cuts, measures tones, checks keyframes and
layers."""

from __future__ import annotations

from typing import cast

from pipeline.errors import BadInput
from pipeline.frames import Plane
from pipeline.methods.analogy.exemplar import save_default_pair
from pipeline.methods.analogy.job_source import JobSource
from pipeline.methods.analogy.layer_source import LayerSource
from pipeline.methods.analogy.layers import Factors, Layer, LayerStatistics, layered_shot
from pipeline.methods.analogy.params import AnalogyParams
from pipeline.methods.analogy.passes import Passes
from pipeline.methods.analogy.sources import keyframe_numbers
from pipeline.methods.base import PlanContext, Task, TaskContext, TaskResult
from pipeline.segmentation.cuts import is_cut, thumbnail
from pipeline.synthesis.tone_matching import ToneAccumulator, ToneStatistics, lab_guide
from pipeline.video.exr import Convention, factors_of

TASK = "video"
_SAMPLED_FRAMES = 24
"""Number of evenly spaced frames from which the tones of a layer are measured."""


def plan_scan(context: PlanContext[AnalogyParams]) -> list[Task]:
    return [Task(TASK, weight=0.05 * max(context.video.frames, 1))]


def run_scan(task: Task, context: TaskContext[AnalogyParams]) -> TaskResult:
    """Count the frames, detect cuts, and measure the tones of the video and of each layer."""
    shot = layered_shot(context)
    frames, cuts, tones = _scan_video(context)
    if not context.has("style_output"):
        with context.clock("style"):
            save_default_pair(context, frames)
    if shot is None:
        context.save("tones", LayerStatistics(tones).arrays())
        return {"frames": frames, "cuts": cuts, "keys": keyframe_numbers(JobSource(context), frames), "layers": []}
    if frames != shot.whole.frames:
        raise BadInput(
            "Some pictures of the shot could not be read.", field="inputs.video", value=f"{frames} of "
            f"{shot.whole.frames}", remedy="Render the others again.",
        )  # fmt: skip
    whole, *layers = [_layer_note(context, layer, tones) for layer in (shot.whole, *shot.layers)]
    return {"frames": frames, "cuts": cuts, "keys": whole["keys"], "says": whole["says"], "layers": layers}


def _scan_video(context: TaskContext[AnalogyParams]) -> tuple[int, list[int], ToneStatistics]:
    params: AnalogyParams = context.params
    before: Plane | None = None
    cuts: list[int] = []
    accumulator, count = ToneAccumulator(), 0
    for index, frame in enumerate(context.frames("video")):
        with context.clock("scan"):
            now = thumbnail(frame)
            if before is not None and is_cut(before, now, params.cut_sensitivity):
                cuts.append(index)
            accumulator.add(lab_guide(frame))
        before, count = now, index + 1
        context.progress(min(1.0, count / max(context.video.frames, count)))
    if not count:
        raise BadInput("The video has no frames.", field="inputs.video", remedy="Upload a video that plays.")
    return count, cuts, accumulator.statistics()


def _layer_note(context: TaskContext[AnalogyParams], layer: Layer, tones: ToneStatistics) -> TaskResult:
    """Check that every picture of a layer can be read, and find the sign of its vectors."""
    source, passes = LayerSource(context, layer, None), Passes(layer, context.size)
    with context.clock("scan"):
        factors, says = _vectors(context, layer, passes)
        keys = keyframe_numbers(source, layer.frames)
        own = tones if layer.number < 0 else _tones(context, layer, passes)
        found = LayerStatistics(own, factors, source.overpaint_px())
    LayerSource(context, layer, found, keyed=bool(keys)).guides  # noqa: B018  (raises what is wrong with them)
    context.save(layer.artefact, found.arrays())
    return {"name": layer.name, "keys": keys, "says": says, "overpaint_px": found.reach_px}


def _tones(context: TaskContext[AnalogyParams], layer: Layer, passes: Passes) -> ToneStatistics:
    """Tone statistics of the pixels inside the layer's silhouette."""
    accumulator = ToneAccumulator()
    for index in range(0, layer.frames, max(1, layer.frames // _SAMPLED_FRAMES)):
        guide, mask = lab_guide(passes.frame(index)), passes.mask(index)
        accumulator.add(guide if mask is None else guide[mask][:, None])
        context.progress(1.0)
    return accumulator.statistics()


def _vectors(context: TaskContext[AnalogyParams], layer: Layer, passes: Passes) -> tuple[Factors | None, str]:
    """Sign factors of the motion vectors of a layer (None = no vectors), and a message about them."""
    if layer.frames < 2 or not passes.has_vectors():
        return None, "Motion is estimated by optical flow."
    wish = layer.vectors or context.params.vectors
    if not isinstance(wish, str):
        return (float(wish[0]), float(wish[1]), float(wish[2])), "Vectors are read as shot.json says."
    at = layer.frames // 2 - 1
    pictures = [(passes.vector_image(index), passes.frame(index)) for index in (at, at + 1)]
    return factors_of(cast(Convention, wish), pictures[0], pictures[1])
