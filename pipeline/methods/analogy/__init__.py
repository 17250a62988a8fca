"""analogy: stylising animation by example (benard2013stylizing).

Give a painting, or a plain picture and its painting: every frame is made of the painting's own pixels, chosen so that
the scene reads, and carried along the motion so that they stay where they are. Needs the whole shot, so not for live.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, ClassVar

from pipeline.frames import Frame
from pipeline.methods.analogy.composite import run_composite
from pipeline.methods.analogy.params import AnalogyParams
from pipeline.methods.analogy.plan import plan_composite, plan_synthesis, run_frames
from pipeline.methods.analogy.run import run_synthesis
from pipeline.methods.analogy.scan import plan_scan, run_scan
from pipeline.methods.base import Brief, Example, InputSpec, Needs, Params, Session, Step, working

__all__ = ["Analogy", "AnalogyParams"]


def _guide(name: str) -> tuple[InputSpec, InputSpec]:
    return (
        InputSpec(f"guide_{name}", "video", False, f"Guide {name}",
                  "A further picture of the scene, a frame for each of the video's: a segment map, a light pass."),
        InputSpec(f"style_guide_{name}", "image", False, f"Guide {name} of the style",
                  f"What guide {name} shows of the painting, of the painting's size."),
    )  # fmt: skip


class Analogy:
    """The method as the registry knows it."""

    name: ClassVar[str] = "analogy"
    title: ClassVar[str] = "Style by example"
    summary: ClassVar[str] = "Paints the shot with the pixels of a painting of yours, and holds them where they are."
    paper: ClassVar[str] = "benard2013stylizing"
    Params: ClassVar[type[Params]] = AnalogyParams
    inputs: ClassVar[tuple[InputSpec, ...]] = (
        InputSpec(
            "video", "video", True, "Video",
            "The video, GIF, image, zip of numbered PNG or EXR images, or shot (frames with passes, layers, styles and "
            "keyframes in folders) to paint.",
        ),
        InputSpec(
            "style_output", "image", False, "Painting",
            "The style: every pixel of the result is one of this picture's. Without one, a frame of the video is "
            "painted in strokes, and is the style.",
        ),
        InputSpec(
            "style", "image", False, "What the painting is of",
            "The plain picture that was painted, registered with it. Without one, the painting's own lightness and "
            "colour take its place.",
        ),
        InputSpec(
            "keyframes", "images", False, "Painted keyframes",
            "Frames of the video as you want them, a zip of images named by frame number; what is transparent is left "
            "to the method. They are matched exactly, and are the style of their shot.",
        ),
        InputSpec(
            "masks", "images", False, "Masks of keyframes",
            "White where a keyframe is painted, instead of its transparency; a zip of images named by frame number.",
        ),
        InputSpec(
            "lines", "video", False, "Lines",
            "Black lines on white, a frame for each of the video's: they are drawn with the strokes of style_lines.",
        ),
        InputSpec(
            "style_lines", "image", False, "Lines of the style",
            "Where the painting's strokes run: black lines on white, of the painting's size.",
        ),
        *_guide("a"), *_guide("b"), *_guide("c"),
    )  # fmt: skip
    steps: ClassVar[tuple[Step, ...]] = (
        Step("scan", "Find the shots", plan_scan, run_scan, weight=0.05),
        Step("synthesise", "Paint", plan_synthesis, run_synthesis),
        Step("composite", "Lay layers over each other", plan_composite, run_composite, weight=0.0),
    )
    artefacts: ClassVar[tuple[str, ...]] = ()
    examples: ClassVar[tuple[Example, ...]] = (
        Example("loose", "Broad brush", {"guide_weight": 1.5, "coherence_weight": 60}),
        Example("close", "Close to the scene", {"guide_weight": 10, "coherence_weight": 5}),
        Example("turning", "Strokes that follow shapes", {"rotation": "on"}),
        Example("varied", "No repeats", {"variety_weight": 200}),
        Example("frames", "Each frame on its own", {"temporal": "off"}),
    )

    @staticmethod
    def needs(step: str, brief: Brief) -> Needs:
        """Peaks by `python -m benchmarks.needs`, and a fifth more: what is worked at, and the offsets of a run as they
        were and as they become. All but the scan computes on the device."""
        at_work = 60 if step == "scan" else 400 + 24 * run_frames((brief.video.width, brief.video.height))
        return working(brief.video, at_work, device=step != "scan")

    def stream(
        self, params: Any, size: tuple[int, int], seed: int, references: Mapping[str, Iterator[Frame]]
    ) -> Session | None:
        """None: sweeps go backward through time as well."""
        return None
