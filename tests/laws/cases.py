"""Generated cases: a method with parameters, inputs and a small film, all from the registry and from one seed.

A new method, parameter or input takes part without being written down here. Only a JSON input needs a sample of its
document, in `DOCUMENTS`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache, cached_property, lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Frame
from pipeline.methods import method, methods, parse_params
from pipeline.methods.applies import Alternatives, When
from pipeline.methods.base import AnyParams, InputSpec, Method
from pipeline.methods.local import Input

WIDTH, HEIGHT = 64, 48
Params = dict[str, Any]

DOCUMENTS: Mapping[tuple[str, str], Any] = {
    ("analogy", "keyframe_settings"): [{"frame": 1, "before": 0, "after": 2, "weight": 3}],
    ("abstraction", "histogram"): {
        "hue": [1.0] * 6 + [0.0] * 30, "saturation_mean": 0.7, "saturation_std": 0.1, "value_mean": 0.5,
    },
    ("multistyle", "design"): {
        "version": 1, "regions": {"left": {"polygons": [{"frame": 1, "points": [[0, 0], [0.5, 0], [0.5, 1], [0, 1]]}]}},
        "keys": [
            {"region": "left", "frame": 0, "set": {"hue": 0}}, {"region": "left", "frame": 5, "set": {"hue": 150}},
            {"region": "rest", "frame": 2, "style": "pointillism"},
        ],
        "directions": [
            {"region": "rest", "edge_weight": 0.1, "elements": [{"pattern": "center", "at": [0.7, 0.5]}]},
        ],
        "corrections": [
            {"region": "left", "frame": 1, "points": [[0.7, 0.2], [0.8, 0.4]], "width": 0.2},
            {"region": "rest", "frame": 4, "points": [[0.2, 0.6]], "width": 0.3},
        ],
    },
    ("patches", "label_intervals"): [{"frame": 2, "before": 1, "after": 1}],
    ("patches", "styles"): {"background": "circles", "2": "wash"},
}  # fmt: skip
"""A sample of each JSON input."""
WITH_INPUT: Mapping[tuple[str, str, str], Any] = {
    ("multistyle", "design", "masks"): {
        "version": 1, "regions": {"marked": {"label": 255}},
        "keys": [
            {"region": "marked", "frame": 0, "set": {"hue": 0}}, {"region": "marked", "frame": 5, "set": {"hue": 150}},
        ],
    },
}  # fmt: skip
"""The sample if another input is given, too: (method, input, other input)."""
SLOW: Mapping[str, float] = {"levels": 4, "iterations": 5, "sweeps": 2, "key_iterations": 3, "patch_radius": 5}
"""Largest values to draw of parameters that multiply the time of a frame."""
SEE_LEAD = 2000
OVER_TIME, KEYED = 61, 0.4
"""Further seed of the draws of values over time, and the share of the cases that have some."""
LONG, LONGER = 0.06, 4
"""Share of the cases whose film has several runs of frames, and the factor on the number of its frames."""


@dataclass(frozen=True)
class Case:
    """One job over one film.

    Attributes:
        inputs: names of the inputs besides the video.
        cut: first frame of the second shot; 0: one shot.
        piece: frames [first, end) of the film.
        scale: factor on WIDTH and HEIGHT.
        light: factor on the brightness of the film.
    """

    seed: int
    method: str
    params: Params
    inputs: tuple[str, ...]
    frames: int
    cut: int
    piece: tuple[int, int]
    scale: int = 1
    light: float = 1.0

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the film, px."""
        return WIDTH * self.scale, HEIGHT * self.scale

    @property
    def chosen(self) -> Method:
        return method(self.method)

    @property
    def parsed(self) -> AnyParams:
        return parse_params(self.chosen, self.params)

    def film(self) -> list[Frame]:
        """The video: a textured square that moves over a texture that pans; another scene after the cut."""
        return [frame.copy() for frame in self._film]

    @cached_property
    def _film(self) -> list[Frame]:
        scenes = [_scene(self.seed + 1000 * (bool(self.cut) and k >= self.cut), k) for k in range(self.frames)]
        return [self._drawn(scene) for scene in scenes]

    def _drawn(self, scene: Frame) -> Frame:
        large = cv2.resize(scene, self.size, interpolation=cv2.INTER_CUBIC) if self.scale > 1 else scene
        return np.asarray(large if self.light == 1 else large * self.light, np.uint8)

    def given(self) -> dict[str, Input]:
        """The other inputs in memory."""
        specs = {spec.name: spec for spec in self.chosen.inputs}
        return {name: _input(self, specs[name]) for name in self.inputs}

    def with_inputs(self, *names: str) -> Case:
        """The case with these inputs, and those that they need."""
        return replace(self, inputs=complete(self.chosen, [*self.inputs, *names]))

    def with_params(self, **changed: Any) -> Case:
        return replace(self, params={**self.params, **changed})


def generated(seed: int, name: str | None = None) -> Case:
    """The case of a seed. `name`: of the method; None: any."""
    draw = np.random.default_rng(seed)
    names = sorted(methods())
    name = name or names[int(draw.integers(len(names)))]
    chosen = method(name)
    frames = int(draw.integers(6, 11))
    first = int(draw.integers(1, frames - 1))
    piece = (first, int(draw.integers(first + 1, frames + 1)))
    properties = properties_of(chosen)
    changed = draw.choice(sorted(properties), size=int(draw.integers(0, 4)), replace=False)
    params = {str(one): drawn_value(properties[one], str(one), draw) for one in changed if one != "preroll"}
    params = with_keys(chosen, params, seed, frames)
    inputs = [spec.name for spec in chosen.inputs[1:] if spec.required or draw.random() < 0.25]
    cut = int(draw.integers(2, frames - 1)) if draw.random() < 0.3 else 0
    if draw.random() < LONG:
        frames, cut = LONGER * frames, LONGER * cut
        first = LONGER * piece[0] + int(draw.integers(LONGER))
        piece = first, max(first + 1, LONGER * piece[1] - int(draw.integers(LONGER)))
    return Case(seed, name, params, complete(chosen, inputs), frames, cut, piece)


def complete(chosen: Method, inputs: list[str]) -> tuple[str, ...]:
    """The inputs, and those that they need."""
    needs = {spec.name: spec.needs for spec in chosen.inputs}
    found = list(inputs)
    for name in found:
        if needs[name] and needs[name] not in found:
            found.append(needs[name])
        style = f"style_{name}"  # a guide needs its counterpart in the style
        if style in needs and style not in found and "keyframes" not in found:
            found.append(style)
    if any(name.startswith("style") for name in found if name != "styled") and "style_output" in needs:
        found += ["style_output"] * ("style_output" not in found)
    return tuple(spec.name for spec in chosen.inputs if spec.name in found)


def properties_of(chosen: Method) -> dict[str, dict[str, Any]]:
    """Schema of every parameter."""
    return _properties_of(chosen.Params)


@cache
def _properties_of(params: type[AnyParams]) -> dict[str, dict[str, Any]]:
    found: dict[str, dict[str, Any]] = params.model_json_schema()["properties"]
    return found


def drawn_value(schema: Mapping[str, Any], name: str, draw: np.random.Generator) -> Any:
    """A value of a parameter other than its default."""
    if "enum" in schema:
        return str(draw.choice([value for value in schema["enum"] if value != schema["default"]]))
    if "pattern" in schema:
        return str(draw.choice(extremes(schema, name)))
    if schema["type"] == "array":
        return extremes(schema, name)[int(draw.integers(2))]
    low, high = schema["minimum"], min(schema["maximum"], SLOW.get(name, float("inf")))
    if schema["type"] == "integer":
        return int(draw.choice([value for value in range(int(low), int(high) + 1) if value != schema["default"]]))
    return float(np.round(draw.choice([low, high, draw.uniform(low, high)]), 4))


def with_keys(chosen: Method, params: Params, seed: int, frames: int) -> Params:
    """The parameters, perhaps with values over time for one that may have them."""
    draw = np.random.default_rng((seed, OVER_TIME))
    varying = chosen.Params.varying()
    if not varying or draw.random() > KEYED:
        return params
    name = str(draw.choice(varying))
    at = sorted(int(frame) for frame in draw.choice(frames + 4, size=int(draw.integers(1, 4)), replace=False))
    return {**params, name: [[frame, drawn_value(properties_of(chosen)[name], name, draw)] for frame in at]}


def extremes(schema: Mapping[str, Any], name: str) -> list[Any]:
    """The values of a parameter that differ most from its default."""
    if "enum" in schema:
        return [value for value in schema["enum"] if value != schema["default"]]
    if "pattern" in schema:  # colours are the only texts with one
        return ["#c02010", "#ffffff"]
    if schema["type"] == "array":  # colours are the only lists
        return [["#c02010", "#f0e0c0", "#203040"], ["#808080"]]
    ends = [schema["minimum"], min(schema["maximum"], SLOW.get(name, float("inf")))]
    ends = [int(end) if schema["type"] == "integer" else float(end) for end in ends]
    return [end for end in ends if end != schema["default"]]


def meeting(case: Case, alternatives: Alternatives) -> Case:
    """The case with the first alternative met."""
    return _meeting(case, alternatives[0]) if alternatives else case


def _meeting(case: Case, when: When) -> Case:
    params = {name: values[0] for name, values in when.params.items()}
    params |= {name: properties_of(case.chosen)[name]["maximum"] for name in when.above}
    inputs = [name for name in case.inputs if name not in when.without] + list(when.inputs[:1])
    return replace(case, params={**case.params, **params}, inputs=complete(case.chosen, inputs))


# -- pictures


@lru_cache(maxsize=8)
def _texture(seed: int, side: int) -> NDArray[np.uint8]:
    draw = np.random.default_rng(seed)
    coarse = draw.integers(20, 236, (side // 8, side // 8, 3)).astype(np.float32)
    picture = cv2.resize(coarse, (side, side), interpolation=cv2.INTER_CUBIC)
    texture: NDArray[np.uint8] = np.clip(picture + draw.normal(0, 6, picture.shape), 0, 255).astype(np.uint8)
    texture.flags.writeable = False
    return texture


def _scene(seed: int, index: int) -> Frame:
    """Frame `index` of a shot: uint8 (HEIGHT, WIDTH, 3)."""
    x = 8 + index % 50
    frame = np.ascontiguousarray(_texture(seed, 128)[10 : 10 + HEIGHT, x : x + WIDTH])
    left = 6 + 2 * index % (WIDTH - 24)
    frame[16:34, left : left + 18] = _texture(seed + 7, 64)[8:26, 8:26]
    return frame


def _half(case: Case, columns: int = WIDTH // 2) -> NDArray[np.uint8]:
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    mask[:, :columns] = 255
    return np.asarray(cv2.resize(mask, case.size, interpolation=cv2.INTER_NEAREST), np.uint8)


def _input(case: Case, spec: InputSpec) -> Input:
    name, film = spec.name, case.film()
    if spec.kind == "json":
        return document(case, name)
    if spec.kind == "images":
        return _images(case, name, film)
    if spec.kind == "video":
        return [_beside(name, frame, index) for index, frame in enumerate(film)]
    return [_still(name, case.seed)]


def mattes(case: Case) -> list[Frame]:
    """A matte by frame, whose edge moves."""
    return [np.dstack([_half(case, WIDTH // 3 + number)] * 3) for number in range(case.frames)]


def document(case: Case, name: str) -> Any:
    """The sample of a JSON input of the case."""
    return next(
        (WITH_INPUT[key] for other in case.inputs if (key := (case.method, name, other)) in WITH_INPUT),
        DOCUMENTS[case.method, name],
    )


def _images(case: Case, name: str, film: list[Frame]) -> dict[int, Any]:
    """Drawings of frames 1 (before most pieces) and 4."""
    numbers = [number for number in (1, 4) if number < case.frames]
    if name == "keyframes":
        return {number: np.ascontiguousarray(255 - film[number]) for number in numbers}
    if name == "labels":
        return {2: np.where(_half(case) > 0, 2, 1).astype(np.uint8)}
    return {number: _half(case, WIDTH // 2 + number) for number in numbers}


def _beside(name: str, frame: Frame, index: int) -> Frame:
    if name == "styled":  # flickers
        return np.clip(255 - frame.astype(np.int16) + (index % 3 - 1) * 25, 0, 255).astype(np.uint8)
    if name == "lines":
        edges = cv2.Canny(frame, 60, 120)
        return np.ascontiguousarray(np.dstack([255 - edges] * 3))
    if name == "directions":
        return np.full_like(frame, (220, 60, 128))
    return np.ascontiguousarray(np.dstack([frame[..., 1]] * 3))


def _still(name: str, seed: int) -> Frame:
    """A picture of the style, all registered with each other; or a reference."""
    painting = np.ascontiguousarray(_texture(seed + 31, 80)[:60, :76])
    if name == "style":
        return np.ascontiguousarray(cv2.GaussianBlur(painting, (0, 0), 2))
    if name in ("style_lines", "style_directions"):
        return _beside(name.removeprefix("style_"), painting, 0)
    if name.startswith("style_guide"):
        return np.ascontiguousarray(np.dstack([painting[..., 1]] * 3))
    return painting
