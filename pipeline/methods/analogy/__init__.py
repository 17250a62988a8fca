"""analogy: stylising animation by example (benard2013stylizing).

The input is a painting, or a plain picture and its painting. Every output pixel shows a place of the painting, found by
guided texture synthesis and kept temporally coherent along the motion of the scene. Sweeps also go backward in time, so
a live stream is not supported.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar

from pydantic import JsonValue

from pipeline.compute import device
from pipeline.errors import BadParameter
from pipeline.frames import Frame
from pipeline.methods.analogy.frame_passes import MADE
from pipeline.methods.analogy.job_inputs import GUIDES
from pipeline.methods.analogy.key_settings import key_settings, settings_document
from pipeline.methods.analogy.keyframe_synthesizer import run_interval
from pipeline.methods.analogy.layer_composite import LAYERS, run_composite
from pipeline.methods.analogy.params import AnalogyParams
from pipeline.methods.analogy.plan import further_keys, plan_composite, plan_synthesis, run_frames
from pipeline.methods.analogy.propagation import Propagator
from pipeline.methods.analogy.scan import plan_scan, run_scan
from pipeline.methods.analogy.sweep_synthesizer import run_sweeps
from pipeline.methods.base import (
    AnyParams,
    Example,
    Fits,
    InputCheck,
    InputFacts,
    InputSpec,
    KeyPropagator,
    LayerPart,
    MadePass,
    Method,
    Params,
    PlanContext,
    Resources,
    Step,
    Studio,
    Task,
    TaskContext,
    TaskResult,
    When,
    resources_per_pixel,
)
from pipeline.methods.input_facts import checked
from pipeline.methods.parts import PaintedKeys
from pipeline.methods.studio import Section

__all__ = ["Analogy", "AnalogyParams"]

STYLE_BYTES = 60
"""Memory of a keyframe as a part of the style, bytes per pixel, in main memory and on the device, at all levels."""
_BESIDE_VIDEO = Fits(size="video", frames="video")
_LIKE_PAINTING = Fits(size="style_output")


def _guide(name: str) -> tuple[InputSpec, InputSpec]:
    return (
        InputSpec(f"guide_{name}", "video", False, f"Guide {name}",
                  "An additional guide with one frame for each frame of the video, for example a segment map or a "
                  "light pass.", fits=_BESIDE_VIDEO),
        InputSpec(f"style_guide_{name}", "image", False, f"Guide {name} of the style",
                  f"The counterpart of guide {name} for the painting; it must have the size of the painting.",
                  applies_when=(When(inputs=(f"guide_{name}",)),), fits=_LIKE_PAINTING),
    )  # fmt: skip


def _run_synthesis(task: Task, context: TaskContext[AnalogyParams]) -> TaskResult:
    """Run a task of the step `synthesise`: an interval between keyframes, or sweeps over a run of frames."""
    return run_interval(task, context) if "interval" in task.args else run_sweeps(task, context)


class Analogy(Method):
    """Registry entry of the method. It has no live form, since its sweeps also go backward in time."""

    name: ClassVar[str] = "analogy"
    title: ClassVar[str] = "Style by example"
    summary: ClassVar[str] = "Paints a shot with the pixels of your painting and keeps them attached to the motion."
    paper: ClassVar[str] = "benard2013stylizing"
    Params: ClassVar[type[Params]] = AnalogyParams
    passes = ("motion", "normals", "ids", "depth", "position", "uv", "mattes")
    inputs: ClassVar[tuple[InputSpec, ...]] = (
        InputSpec(
            "video", "video", True, "Video",
            "The video, image, animated image, zip of numbered images, or shot (frames with passes, layers, styles and "
            "keyframes in folders) to paint.",
        ),
        InputSpec(
            "style_output", "image", False, "Painting",
            "The style: every colour of the result is a colour of this picture. Without it, the method paints one "
            "frame of the video in strokes and uses that as the style.",
        ),
        InputSpec(
            "style", "image", False, "Scene of the painting",
            "The picture that the painting shows, registered with the painting. Without it, the smoothed lightness and "
            "colour of the painting are used.",
            needs="style_output", fits=_LIKE_PAINTING,
        ),
        InputSpec(
            "keyframes", "images", False, "Painted keyframes",
            "Painted frames of the video: a zip of images named by frame number. The method fills transparent pixels. "
            "Keyframes are reproduced exactly and are the style of their shot.", "keys.image",
            preview=False, fits=Fits(size="video"),
        ),
        InputSpec(
            "masks", "images", False, "Masks of keyframes",
            "White where a keyframe is painted; replaces its transparency. A zip of images named by frame number.",
            "keys.mask", needs="keyframes", fits=Fits(size="video"),
        ),
        InputSpec(
            "keyframe_settings", "json", False, "Reach and weight of keyframes",
            'How many frames before and after it a keyframe reaches, and its weight (0.1 to 10) between two keyframes: '
            '[{"frame": 40, "before": 10, "after": 12, "weight": 2}]. Without it, a keyframe reaches up to the next '
            "ones. Frames that none reaches are painted as those of a shot without keyframes.",
            "keys", needs="keyframes",
        ),
        InputSpec(
            "lines", "video", False, "Lines",
            "Black lines on white, one frame for each frame of the video. They are drawn with the strokes of "
            "style_lines.", fits=_BESIDE_VIDEO,
        ),
        InputSpec(
            "style_lines", "image", False, "Lines of the style",
            "The lines of the painting: black on white; it must have the size of the painting.",
            needs="lines", fits=_LIKE_PAINTING,
        ),
        InputSpec(
            "directions", "video", False, "Directions of the strokes",
            "Direction of the strokes at each pixel, one frame for each frame of the video: red = x, green = y "
            "(255 = up), as in normal maps; gray = computed from the picture.",
            fits=_BESIDE_VIDEO,
        ),
        InputSpec(
            "style_directions", "image", False, "Directions of the style",
            "Direction of the strokes of the painting, coded alike; it must have the size of the painting. Without it, "
            "directions are computed.", fits=_LIKE_PAINTING,
        ),
        *_guide("a"), *_guide("b"), *_guide("c"),
    )  # fmt: skip
    steps: ClassVar[tuple[Step[AnalogyParams], ...]] = (
        Step("scan", "Find the shots", plan_scan, run_scan, weight=0.05, version=3),
        Step("synthesise", "Paint", plan_synthesis, _run_synthesis, version=5),
        Step("composite", "Composite layers", plan_composite, run_composite, weight=0.0, version=2),
    )
    part_documents: ClassVar[Mapping[str, Callable[[Any], JsonValue]]] = {"keyframe_settings": settings_document}
    input_checks: ClassVar[Mapping[str, InputCheck]] = {"keyframe_settings": checked(key_settings)}
    parts: ClassVar[tuple[LayerPart, ...]] = (LayerPart("keys", "Painted keys", PaintedKeys, former={"keys": ""}),)
    artefacts: ClassVar[tuple[str, ...]] = (LAYERS,)
    makes_passes: ClassVar[tuple[MadePass, ...]] = MADE
    palette_input: ClassVar[str] = "style_output"
    studio: ClassVar[Studio] = Studio(
        sections=(Section("keys", "keys", "Painted keys"),),
        tools=("brush", "eraser", "smudge", "fill", "picker", "object"),
        painting="style_output",
        painting_source="style",
        cuts="cut_sensitivity",
    )
    cpu_s_per_megapixel: ClassVar[float] = 4.7
    examples: ClassVar[tuple[Example, ...]] = (
        Example("loose", "Broad brush strokes", {"guide_weight": 1.5, "coherence_weight": 60}),
        Example("close", "Close to the scene", {"guide_weight": 10, "coherence_weight": 5}),
        Example("turning", "Strokes that follow shapes", {"rotation": "on"}),
        Example("varied", "No repetitions", {"variety_weight": 200, "variety_limit": 2}),
        Example("frames", "Independent frames", {"temporal": "off"}),
    )

    def load(self) -> None:
        """Open the compute device."""
        device()

    def input_faults(self, params: AnyParams, facts: Mapping[str, InputFacts]) -> list[BadParameter]:
        """Guides and lines without a counterpart in the style, and masks and settings of frames without a key."""
        keyed = "keyframes" in facts
        pairs = [("lines", "style_lines"), *((f"guide_{name}", f"style_guide_{name}") for name in GUIDES)]
        found = [
            BadParameter(
                f"The input {name!r} has no counterpart in the style.", field=f"inputs.{style}",
                remedy=f"Give {style}, of the painting's size, or leave {name} out.",
            )
            for name, style in pairs if name in facts and style not in facts and not keyed
        ]  # fmt: skip
        keys, masks = (facts[name].numbers if name in facts else None for name in ("keyframes", "masks"))
        for number in sorted((masks or frozenset()) - keys) if keys is not None else ():
            found.append(BadParameter(
                f"Frame {number} has a mask and no keyframe.", field=f"inputs.masks[{number}]", value=number,
                remedy="Give its keyframe, or leave the mask out.",
            ))  # fmt: skip
        document = facts["keyframe_settings"].document if "keyframe_settings" in facts else None
        rows = document if isinstance(document, list) and keys is not None else []
        for place, row in enumerate(rows):
            if isinstance(row, dict) and row.get("frame", -1) not in (keys or ()):
                found.append(BadParameter(
                    f"Frame {row.get('frame')} has settings and no keyframe.",
                    field=f"inputs.keyframe_settings[{place}]", value=row.get("frame"),
                    remedy="Give its keyframe, or leave the row out.",
                ))  # fmt: skip
        return found

    def single_frame_params(self, params: AnalogyParams) -> AnalogyParams:
        """Parameters for a single frame of a video: without temporal coherence, and without the adjustments for
        stills."""
        return params.model_copy(update={"temporal": "off", "guided_stills": "off"})

    def propagator(self, params: AnalogyParams, frames: Sequence[Frame], seed: int) -> KeyPropagator | None:
        """Propagates an edited keyframe along the motion; None without temporal coherence, or with values over time."""
        return Propagator(frames, params, seed) if params.temporal == "on" and not params.over_time else None

    def resources(self, step: str, context: PlanContext[AnalogyParams]) -> Resources:
        """Peak memory of a task: measured with `python -m benchmarks.task_memory`, plus 20 %.

        It covers the working images and the old and new offset fields of a run, and the keyframes that are the style
        of an interval beside those at its ends. All steps except the scan use the compute device.
        """
        size = (context.video.width, context.video.height)
        bytes_per_pixel = 60 if step == "scan" else 400 + 24 * run_frames(size)
        if step == "synthesise":
            bytes_per_pixel += STYLE_BYTES * further_keys(context)
        return resources_per_pixel(context.video, bytes_per_pixel, device=step != "scan")
