"""The rendered cases: every method with every renderer, style source and keyframe mode that has separate code."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from tests.regression import clips

Inputs = Mapping[str, Any]
NoInputs: Callable[[], Inputs] = dict


@dataclass(frozen=True)
class Case:
    """One render.

    Attributes:
        inputs: makes the inputs beside the video; called when the case is rendered.
        artefacts: optional artefacts to ask for.
        device: whether it computes on the OpenCL device.
    """

    method: str
    name: str
    clip: Literal["cut", "shapes", "long-shapes", "haze"]
    params: Mapping[str, Any] = field(default_factory=dict)
    inputs: Callable[[], Inputs] = NoInputs
    artefacts: frozenset[str] = frozenset()
    device: bool = False

    @property
    def id(self) -> str:
        return f"{self.method}/{self.name}"


def _abstraction() -> Iterator[Case]:
    def case(name: str, clip: Any = "cut", device: bool = False, **more: Any) -> Case:
        return Case("abstraction", name, clip, device=device, **more)

    histogram = {"hue": [1, 0, 3, *[0] * 33], "saturation_mean": 0.5, "saturation_std": 0.2, "value_mean": 0.6}
    yield case("default", artefacts=frozenset({"svg"}))
    yield case("occlusion", "shapes")
    yield case("no-lines", params={"lines": "off"})
    yield case("line-colour", params={"line_colour": "#7a1f1f", "line_width": 4})
    yield case("palette", params={"palette": ["#101820", "#f4efe0", "#c0502a", "#2f6f8f"]})
    yield case("dis-medium", params={"flow": "dis-medium"})
    yield case("tvl1", "shapes", params={"flow": "tvl1"}, device=True)
    yield case("frames-alone", params={"temporal": "off"})
    yield case("reference", inputs=lambda: {"reference": [clips.painting()]})
    yield case("histogram", inputs=lambda: {"histogram": histogram})
    yield case("importance", "shapes", inputs=lambda: {"importance": {0: clips.middle_mask()}})
    yield case("sharp", params={"edges": "sharp"})
    yield case("low-contrast", "haze")
    yield case("every-option-of-time", params={"cut_sensitivity": 0, "colour_half_life": 0, "paint_memory": 0})


def _patches() -> Iterator[Case]:
    def case(name: str, clip: Any = "shapes", **more: Any) -> Case:
        return Case("patches", name, clip, **more)

    yield case("default", "long-shapes", artefacts=frozenset({"labels", "patches", "energy", "uncertainty"}))
    yield case("cut", "cut")
    for style in ("circles", "impressionist", "expressionist", "wash"):
        yield case(style, params={"style": style})
    yield case("background-style", params={"background_style": "wash"})
    yield case("styles", inputs=lambda: {"styles": {"background": "circles", "2": "wash"}})
    yield case("masks", inputs=lambda: {"masks": {0: clips.middle_mask()}})
    yield case("labels", inputs=lambda: {"labels": {0: clips.object_labels(0), 5: clips.object_labels(5)}})
    yield case("frames-alone", params={"temporal": "off", "frames_per_painting": 3})
    yield case("rigidity", params={"rigidity": 0, "colour_edges": 0, "interframe": 0.5})


def _analogy() -> Iterator[Case]:
    quick = {"levels": 2, "iterations": 2}

    def case(name: str, make: Callable[[], Inputs], clip: Any = "shapes", **params: Any) -> Case:
        return Case("analogy", name, clip, quick | params, make, device=True)

    def files(make: Callable[[], Mapping[str, bytes]]) -> Callable[[], Inputs]:
        return lambda: {"video.entries": make()}

    def painting() -> Inputs:
        return {"style_output": [clips.painting()]}

    def pair() -> Inputs:
        return {**painting(), "style": [clips.plain()]}

    yield case("own-frame", NoInputs, "cut")
    yield case("painting", painting, "cut")
    yield case("painting-fast", painting, "cut", refinement="fast")
    yield case("pair", pair)
    yield case("rotation", painting, rotation="on")
    yield case("lab", painting, colours="lab", tone_match="on")
    yield case("variety", painting, variety_weight=200, variety_limit=2)
    yield case("frames-alone", painting, temporal="off")
    yield case("guides", lambda: {**pair(), "guide_a": list(clips.object_maps()),
                                  "style_guide_a": [clips.painting_objects()]})  # fmt: skip
    yield case("lines", lambda: {**pair(), "lines": list(clips.line_art()), "style_lines": [clips.painting_lines()]})
    yield case("one-keyframe", lambda: {"keyframes": {3: clips.keyframe(3)}})
    yield case("two-keyframes", lambda: {"keyframes": {1: clips.keyframe(1), 6: clips.keyframe(6)}})
    yield case("partial-keyframe", lambda: {"keyframes": {3: clips.partial_keyframe(3)}})
    yield case("masked-keyframe",
               lambda: {"keyframes": {3: clips.keyframe(3)}, "masks": {3: clips.middle_mask()}})  # fmt: skip
    yield case("shot", files(clips.unlayered_shot))
    yield case("layers", files(clips.styled_shot))
    yield case("layer-keyframe", files(clips.keyed_shot))


def _multistyle() -> Iterator[Case]:
    def case(name: str, clip: Any = "cut", **more: Any) -> Case:
        return Case("multistyle", name, clip, **more)

    for style in ("van-gogh", "impressionism", "expressionism", "pointillism", "colorist-wash", "watercolor"):
        yield case(style, params={"style": style})
    yield case("occlusion", "shapes")
    yield case("explicit", params={"renderer": "explicit"})
    yield case("explicit-eased", params={"renderer": "explicit", "ease": 1})
    yield case("frames-alone", params={"temporal": "off"})
    yield case("no-accumulation", params={"accumulated_frames": 0})
    for effect in ("rack-focus", "emphasis", "calm-to-stress"):
        yield case(effect, params={"effect": effect})
    yield case(
        "design", "shapes", artefacts=frozenset({"regions"}),
        inputs=lambda: {"design": clips.DESIGN, "masks": {1: clips.left_labels(40), 4: clips.left_labels(30)}},
    )  # fmt: skip


def _steady() -> Iterator[Case]:
    def case(name: str, clip: Any, inputs: Callable[[], Inputs], **params: Any) -> Case:
        return Case("steady", name, clip, params, inputs)

    yield case("cut", "cut", lambda: {"styled": list(clips.posterized(clips.cut()))})
    yield case("mask", "shapes", lambda: {"styled": list(clips.posterized(clips.shapes())),
                                          "mask": {2: clips.middle_mask()}})  # fmt: skip
    yield case("no-detail", "shapes", lambda: {"styled": list(clips.posterized(clips.shapes()))}, detail=0,
               colour_half_life=0)  # fmt: skip


CASES: dict[str, Case] = {
    case.id: case for cases in (_abstraction(), _patches(), _analogy(), _multistyle(), _steady()) for case in cases
}
