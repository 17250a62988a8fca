"""Layers in one job are painted as by separate jobs and then composited: order, opacity, blend modes, mattes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pipeline.compositing import lay_over
from pipeline.errors import BadInput, BadParameter
from pipeline.frames import Frame
from pipeline.methods import method, methods, parse_params
from pipeline.methods.layers import LAYERS
from pipeline.methods.layers.layer_context import PIECE_FRAMES
from pipeline.methods.local import LocalContext, run_plan
from tests.conftest import tiny_frame

COUNT = PIECE_FRAMES + 3
CLIP = [tiny_frame(index) for index in range(COUNT)]


def painted(name: str, params: dict[str, Any], video: list[Frame] = CLIP, seed: int = 0, **inputs: Any) -> list[Frame]:
    chosen = method(name)
    context: LocalContext[Any] = LocalContext(parse_params(chosen, params), video, inputs, seed)
    run_plan(chosen, context)
    return [context.emitted[index] for index in range(COUNT)]


def layered(*layers: dict[str, Any], **inputs: Any) -> list[Frame]:
    return painted(LAYERS, {"layers": list(layers)}, **inputs)


STROKES = {"method": "multistyle", "params": {"style": "pointillism"}, "seed": 5}


def test_two_layers_are_their_own_films_laid_over_each_other() -> None:
    below, above = painted("abstraction", {}), painted("multistyle", STROKES["params"], seed=5)  # type: ignore[arg-type]
    found = layered({"method": "abstraction"}, {**STROKES, "opacity": 0.6, "blend": "multiply"})
    for k in range(COUNT):
        assert np.array_equal(found[k], lay_over(below[k], above[k], 0.6, "multiply")), k


def test_the_order_of_layers_counts() -> None:
    front = layered({"method": "abstraction"}, STROKES)
    back = layered(STROKES, {"method": "abstraction"})
    assert np.array_equal(front[0], painted("multistyle", {"style": "pointillism"}, seed=5)[0])
    assert not np.array_equal(front[0], back[0])


def test_a_translucent_layer_lies_over_the_video() -> None:
    (own,) = {frame.tobytes() for frame in painted("abstraction", {})[:1]}
    expected = lay_over(CLIP[0], np.frombuffer(own, np.uint8).reshape(CLIP[0].shape), 0.5)
    assert np.array_equal(layered({"method": "abstraction", "opacity": 0.5})[0], expected)


def test_a_matte_limits_its_layer_and_a_still_matte_serves_every_frame() -> None:
    matte = np.zeros_like(CLIP[0])
    matte[:, :40] = 255
    found = layered({"method": "abstraction", "matted": True}, **{"layer0.matte": [matte]})
    own = painted("abstraction", {})
    for k in (0, COUNT - 1):
        assert np.array_equal(found[k][:, :40], own[k][:, :40])
        assert np.array_equal(found[k][:, 40:], CLIP[k][:, 40:])


def test_a_layer_paints_its_own_video() -> None:
    other = [np.ascontiguousarray(frame[:, ::-1]) for frame in CLIP]
    found = layered({"method": "abstraction"}, **{"layer0.video": other})
    assert np.array_equal(found[3], painted("abstraction", {}, other)[3])
    with pytest.raises(BadInput, match="another size"):
        layered({"method": "abstraction"}, **{"layer0.video": [frame[:32] for frame in other]})


def test_inputs_of_a_layer_reach_it() -> None:
    key = np.full_like(CLIP[0], 40)
    found = layered({"method": "abstraction"}, {"method": "analogy"}, **{"layer1.keyframes": {4: key}})
    assert np.array_equal(found[4], key), "a painted key is in the film exactly"


def test_every_order_of_tasks_gives_the_same_frames() -> None:
    chosen = method(LAYERS)
    params = parse_params(chosen, {"layers": [{"method": "patches"}, {**STROKES, "opacity": 0.5}]})
    films = []
    for shuffle in (None, 1):
        context: LocalContext[Any] = LocalContext(params, CLIP)
        run_plan(chosen, context, shuffle)
        films.append(b"".join(context.emitted[index].tobytes() for index in range(COUNT)))
    assert films[0] == films[1]


def test_parameters_are_completed_and_checked() -> None:
    params: Any = parse_params(method(LAYERS), {"layers": [{"method": "abstraction", "params": {"lines": "off"}}]})
    assert set(params.layers[0].params) == set(methods()["abstraction"].Params.model_fields)
    for wrong in ({"method": "abstraction", "params": {"line": 1}}, {"method": LAYERS}, {"method": "x", "blend": "y"}):
        with pytest.raises(BadParameter, match="layers"):
            parse_params(method(LAYERS), {"layers": [wrong]})
