"""The step `scan`: one pass over everything that was given. Counts, cuts, tones; keys and layers checked by picture."""

from __future__ import annotations

from typing import cast

from pipeline.errors import BadInput
from pipeline.frames import Plane
from pipeline.methods.analogy.exemplar import keep_own
from pipeline.methods.analogy.job_source import JobSource
from pipeline.methods.analogy.keys import key_numbers
from pipeline.methods.analogy.layer_source import LayerSource
from pipeline.methods.analogy.layers import Factors, Found, Layer, shot_of
from pipeline.methods.analogy.params import AnalogyParams
from pipeline.methods.analogy.passes import Passes
from pipeline.methods.base import Bench, Brief, Note, Task
from pipeline.segmentation.cuts import is_cut, thumbnail
from pipeline.synthesis.tones import Tally, Tones, lab_guide
from pipeline.video.exr import Convention, factors_of

TASK = "video"
_LOOKS = 24
"""Frames of a layer that its tones are learnt from, evenly spread."""


def plan_scan(brief: Brief) -> list[Task]:
    return [Task(TASK, weight=0.05 * max(brief.video.frames, 1))]


def run_scan(task: Task, bench: Bench) -> Note:
    """Count the frames, call the cuts, and learn the tones of the video and of each layer."""
    shot = shot_of(bench)
    frames, cuts, tones = _watch(bench)
    if not bench.has("style_output"):
        with bench.clock("style"):
            keep_own(bench, frames)
    if shot is None:
        bench.save("tones", Found(tones).arrays())
        return {"frames": frames, "cuts": cuts, "keys": key_numbers(JobSource(bench), frames), "layers": []}
    if frames != shot.whole.frames:
        raise BadInput(
            "Not every picture of the shot could be read.", field="inputs.video", value=f"{frames} of "
            f"{shot.whole.frames}", remedy="Render the others again.",
        )  # fmt: skip
    whole, *layers = [_layer_note(bench, layer, tones) for layer in (shot.whole, *shot.layers)]
    return {"frames": frames, "cuts": cuts, "keys": whole["keys"], "says": whole["says"], "layers": layers}


def _watch(bench: Bench) -> tuple[int, list[int], Tones]:
    params: AnalogyParams = bench.params
    before: Plane | None = None
    cuts: list[int] = []
    tally, count = Tally(), 0
    for index, frame in enumerate(bench.frames("video")):
        with bench.clock("scan"):
            now = thumbnail(frame)
            if before is not None and is_cut(before, now, params.cut_sensitivity):
                cuts.append(index)
            tally.add(lab_guide(frame))
        before, count = now, index + 1
        bench.progress(min(1.0, count / max(bench.video.frames, count)))
    if not count:
        raise BadInput("The video has no frames.", field="inputs.video", remedy="Upload a video that plays.")
    return count, cuts, tally.tones()


def _layer_note(bench: Bench, layer: Layer, tones: Tones) -> Note:
    """Look at a layer: every picture that will be asked for can be read, and how its vectors are signed."""
    source, passes = LayerSource(bench, layer, None), Passes(layer, bench.size)
    with bench.clock("scan"):
        factors, says = _vectors(bench, layer, passes)
        keys = key_numbers(source, layer.frames)
        own = tones if layer.number < 0 else _tones(bench, layer, passes)
        found = Found(own, factors, source.overpaint_px())
    LayerSource(bench, layer, found, keyed=bool(keys)).guides  # noqa: B018  (raises what is wrong with them)
    bench.save(layer.artefact, found.arrays())
    return {"name": layer.name, "keys": keys, "says": says, "overpaint_px": found.reach_px}


def _tones(bench: Bench, layer: Layer, passes: Passes) -> Tones:
    """Of the layer's own pixels."""
    tally = Tally()
    for index in range(0, layer.frames, max(1, layer.frames // _LOOKS)):
        guide, mask = lab_guide(passes.frame(index)), passes.mask(index)
        tally.add(guide if mask is None else guide[mask][:, None])
        bench.progress(1.0)
    return tally.tones()


def _vectors(bench: Bench, layer: Layer, passes: Passes) -> tuple[Factors | None, str]:
    """The factors of its motion vectors, and a sentence about them."""
    if layer.frames < 2 or not passes.has_vectors():
        return None, "Motion is estimated by optical flow."
    wish = layer.vectors or bench.params.vectors
    if not isinstance(wish, str):
        return (float(wish[0]), float(wish[1]), float(wish[2])), "Vectors are read as shot.json says."
    at = layer.frames // 2 - 1
    pictures = [(passes.vector_image(index), passes.frame(index)) for index in (at, at + 1)]
    return factors_of(cast(Convention, wish), pictures[0], pictures[1])
