"""Requirements for every registered method: schema, pure plans, reproducible bytes."""

from __future__ import annotations

import math
import re
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest

import pipeline
from pipeline.errors import BadInput, BadParameter
from pipeline.frames import Frame
from pipeline.method_names import PLATFORM
from pipeline.methods import method, methods, parse_params
from pipeline.methods.base import PROCESS_BYTES, Method, PlanContext, VideoInfo, seeded
from pipeline.methods.local import LocalContext, required_inputs, run_plan
from pipeline.scenes import scene
from tests.pipeline.methods.frames import painted

SIZE = (64, 48)
every_method = pytest.mark.parametrize("chosen", methods().values(), ids=methods().keys())

built_in = {name: chosen for name, chosen in methods().items() if type(chosen).__module__.startswith("pipeline.")}
every_built_in_method = pytest.mark.parametrize("chosen", built_in.values(), ids=built_in.keys())


@cache
def shot() -> list[Frame]:
    made = scene("cut", SIZE, frames=6, fps=6)
    return [made.image(index) for index in range(6)]


def in_memory(chosen: Method, **more: Any) -> LocalContext[Any]:
    return LocalContext(chosen.Params(), shot(), required_inputs(chosen, shot()), **more)


def test_a_method_is_imported_without_the_others() -> None:
    code = "import sys; from pipeline.methods import method; method('steady'); print(*sys.modules, sep='\\n')"
    loaded = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout.split()
    assert "pipeline.methods.steady" in loaded
    assert not {"pipeline.methods.patches", "pipeline.methods.analogy"} & set(loaded)


def test_methods_are_registered_by_their_own_names() -> None:
    assert {name: chosen.name for name, chosen in methods().items()} == {name: name for name in methods()}
    assert {name: method(name).name for name in PLATFORM} == {name: name for name in PLATFORM}


def fields(chosen: Method) -> dict[str, dict[str, Any]]:
    found: dict[str, dict[str, Any]] = chosen.Params.model_json_schema()["properties"]
    return found


# -- what a method says of itself


@every_method
def test_a_method_has_a_name_a_title_a_summary_and_a_paper(chosen: Method) -> None:
    assert re.fullmatch(r"[a-z][a-z0-9-]*", chosen.name) and method(chosen.name) is chosen
    assert chosen.title and chosen.summary.endswith(".")
    papers = (Path(pipeline.__path__[0]) / "references.bib").read_text()
    assert f"{{{chosen.paper}," in papers


@every_method
def test_inputs_start_with_the_video_and_have_help_texts(chosen: Method) -> None:
    video = chosen.inputs[0]
    assert (video.name, video.kind, video.required) == ("video", "video", True)
    assert len({spec.name for spec in chosen.inputs}) == len(chosen.inputs)
    assert all(spec.title and len(spec.help) > 10 for spec in chosen.inputs)


@every_method
def test_the_schema_is_valid_and_accepts_the_defaults(chosen: Method) -> None:
    schema = chosen.Params.model_json_schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    assert schema["additionalProperties"] is False
    jsonschema.validate(chosen.Params().model_dump(mode="json"), schema)


@every_method
def test_every_parameter_has_what_a_form_shows(chosen: Method) -> None:
    for name, field in fields(chosen).items():
        assert field["title"] and len(field["description"]) > 10, name
        assert field["group"], name
        assert "default" in field, name
        if "minimum" in field:
            assert field["unit"], name
            assert field["minimum"] <= field["default"] <= field["maximum"], name
        elif "pattern" in field:
            assert re.fullmatch(field["pattern"], field["default"]), name
        elif field.get("type") == "array":
            assert field["maxItems"] and all(re.fullmatch(field["items"]["pattern"], one) for one in field["default"])
        else:
            assert field["default"] in field["enum"], name


@every_method
def test_examples_are_valid_and_distinct(chosen: Method) -> None:
    assert len({example.name for example in chosen.examples}) == len(chosen.examples)
    made = [parse_params(chosen, example.params) for example in chosen.examples]
    assert all(params != chosen.Params() for params in made)
    assert all(example.title for example in chosen.examples)
    schema = jsonschema.Draft202012Validator(chosen.Params.model_json_schema())
    for example in chosen.examples:
        schema.validate(example.params)


@every_built_in_method
def test_resources_depend_on_the_frame_size_and_not_on_the_length(chosen: Method) -> None:
    def asked(step: str, width: int, height: int, frames: int = 100) -> int:
        context = PlanContext(chosen.Params(), 0, VideoInfo(width, height, frames, 25.0, frames / 25))
        needs = chosen.resources(step, context)
        assert needs is not None and needs.gpus in (None, 0.0)
        return needs.memory_bytes

    for step in (step.name for step in chosen.steps):
        assert PROCESS_BYTES < asked(step, 64, 48) < 2 * PROCESS_BYTES
        assert asked(step, 640, 360) < asked(step, 1280, 720) < asked(step, 3840, 2160) < 16 << 30
        assert asked(step, 640, 360) == asked(step, 640, 360, 100_000)


# -- what is refused


def numbers(chosen: Method) -> list[str]:
    return [name for name, field in fields(chosen).items() if "number" in field.get("type", "")]


@every_method
def test_invalid_numbers_are_rejected_by_name(chosen: Method) -> None:
    for name in numbers(chosen):
        for value in (math.nan, math.inf, -math.inf, "NaN", None, "wide"):
            refused(chosen, {name: value}, name)


@every_method
def test_numbers_out_of_range_are_rejected_and_limits_accepted(chosen: Method) -> None:
    for name, field in fields(chosen).items():
        if "minimum" not in field:
            continue
        refused(chosen, {name: field["minimum"] - 1}, name)
        refused(chosen, {name: field["maximum"] + 1}, name)
        parse_params(chosen, {name: field["minimum"]})
        parse_params(chosen, {name: field["maximum"]})


@every_method
def test_an_unknown_choice_is_rejected(chosen: Method) -> None:
    for name, field in fields(chosen).items():
        if "enum" in field:
            refused(chosen, {name: "no such choice"}, name)


@every_method
def test_an_unknown_parameter_is_rejected_with_the_known_ones(chosen: Method) -> None:
    fault = refused(chosen, {"speling": 1}, "speling")
    assert next(iter(fields(chosen))) in fault.remedy


@every_method
def test_parameters_are_immutable(chosen: Method) -> None:
    params = chosen.Params()
    with pytest.raises(ValueError, match="frozen"):
        setattr(params, next(iter(fields(chosen))), 1)


@pytest.mark.parametrize(
    ("name", "former", "present", "value"),
    [
        ("patches", "hold", "frames_per_painting", 3),
        ("multistyle", "hold", "noise_floor", 5.0),
        ("multistyle", "linger", "accumulated_frames", 1),
    ],
)
def test_a_former_parameter_name_sets_the_present_parameter(name: str, former: str, present: str, value: float) -> None:
    chosen = method(name)
    assert parse_params(chosen, {former: value}) == parse_params(chosen, {present: value})
    assert former not in chosen.Params.model_json_schema()["properties"]
    with pytest.raises(BadParameter, match=f"former name of '{present}'"):
        parse_params(chosen, {former: value, present: value})


def test_an_unknown_method_is_rejected_with_the_known_ones() -> None:
    with pytest.raises(BadParameter) as caught:
        method("abstracton")
    assert caught.value.field == "method" and all(name in caught.value.remedy for name in methods())


def refused(chosen: Method, values: dict[str, Any], name: str) -> BadParameter:
    with pytest.raises(BadParameter) as caught:
        parse_params(chosen, values)
    assert caught.value.field == f"params.{name}" and caught.value.message and caught.value.remedy
    return caught.value


# -- plans


@every_method
def test_task_keys_are_valid_and_frames_are_emitted_once(chosen: Method) -> None:
    context = Recorder(chosen, shot())
    tasks = run_plan(chosen, context)
    for listed in tasks.values():
        keys = [task.key for task in listed]
        assert len(set(keys)) == len(keys)
        assert all(re.fullmatch(r"[a-z0-9-]+", key) for key in keys)
        assert all(set(task.after) <= set(keys) and task.weight > 0 for task in listed)
    assert painted(context).shape == (len(shot()), SIZE[1], SIZE[0], 3)
    assert painted(context).dtype == np.uint8
    assert context.order == list(range(len(shot())))
    assert context.done and min(context.done) >= 0 and max(context.done) <= 1


class Recorder(LocalContext[Any]):
    """Records the order of emitted frames and the progress that tasks report."""

    def __init__(self, chosen: Method, video: list[Frame]) -> None:
        super().__init__(chosen.Params(), video, required_inputs(chosen, video))
        self.order: list[int] = []
        self.done: list[float] = []

    def emit(self, index: int, frame: Frame) -> None:
        super().emit(index, frame)
        self.order.append(index)

    def progress(self, done: float) -> None:
        self.done.append(done)


@every_method
def test_a_plan_depends_on_its_context_only(chosen: Method) -> None:
    context, results = in_memory(chosen), dict[str, dict[str, Any]]()
    for step in chosen.steps:
        planned = PlanContext(context.params, context.seed, context.video, frozenset(context.inputs), results)
        tasks = list(step.plan(planned))
        assert list(step.plan(planned)) == tasks
        context.step = step.name
        for task in tasks:
            context.task = task
            results.setdefault(step.name, {})[task.key] = step.run(task, context)


@every_method
def test_the_same_request_gives_the_same_bytes_in_any_order(chosen: Method) -> None:
    first, second = (in_memory(chosen, artefacts=frozenset(chosen.artefacts)) for _ in range(2))
    run_plan(chosen, first)
    run_plan(chosen, second, shuffle=1)
    np.testing.assert_array_equal(painted(first), painted(second))
    assert first.files == second.files


@every_method
def test_a_wrong_frame_count_in_the_container_changes_nothing(chosen: Method) -> None:
    honest, lying = (in_memory(chosen) for _ in range(2))
    lying.video = VideoInfo(*SIZE, frames=1, fps=25.0, duration_s=0.04)
    for context in (honest, lying):
        run_plan(chosen, context)
    np.testing.assert_array_equal(painted(honest), painted(lying))


@every_method
def test_a_video_without_frames_is_rejected(chosen: Method) -> None:
    with pytest.raises(BadInput) as caught:
        run_plan(chosen, LocalContext(chosen.Params(), [], required_inputs(chosen, [])))
    assert caught.value.field == "inputs.video" and caught.value.remedy


@every_method
def test_a_live_session_paints_what_a_job_paints(chosen: Method) -> None:
    session = chosen.stream(chosen.Params(), SIZE, 0, {})
    if session is None:
        pytest.skip("not a causal method")
    context = in_memory(chosen)
    run_plan(chosen, context)
    np.testing.assert_array_equal(np.stack([session.step(frame) for frame in shot()]), painted(context))


# -- random numbers


def test_random_numbers_depend_on_seed_and_purpose_only() -> None:
    drawn = {key: tuple(seeded(*key).integers(0, 1 << 30, 4)) for key in ((0, 1), (0, 2), (1, 1), (0, 1, 0))}
    assert len(set(drawn.values())) == 4
    assert tuple(seeded(0, 1).integers(0, 1 << 30, 4)) == drawn[0, 1]
