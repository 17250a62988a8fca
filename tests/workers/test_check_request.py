"""Validation of requests: every refusal names the field, the value and the remedy."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from pipeline.errors import BadParameter
from workers.contract.record import Asset
from workers.contract.request import JobRequest, OutputSpec
from workers.scheduling.check_request import check_request


def _asset(kind: str, **info: Any) -> Asset:
    return Asset("ast_1", "1", 1, "x", "x/y", kind, info, 0.0)


DATA = _asset("json")
GOOD = JobRequest("toy", {"data": "ast_1"})


def test_defaults_of_a_valid_request_are_filled_in() -> None:
    accepted = check_request(replace(GOOD, params={"tasks": 2}), {"data": DATA})
    defaults = {"gpus": 0.0, "memory_mib": 0}
    assert accepted.params == {"tasks": 2, "chain": False, "sleep_s": 0.0, "trouble": "", "mark": ""} | defaults
    assert [name for name, _ in accepted.steps] == ["analyze", "draw", "assemble"]


BAD: list[tuple[str, dict[str, Any]]] = [
    ("method", {"method": "oil"}),
    ("params.tasks", {"params": {"tasks": -1}}),
    ("params.sleep_s", {"params": {"sleep_s": float("nan")}}),
    ("params.brush", {"params": {"brush": 1}}),
    ("output.format", {"output": OutputSpec("avi")}),
    ("output.quality", {"output": OutputSpec(quality=52)}),
    ("output.artefacts", {"output": OutputSpec(artefacts=("labels",))}),
    ("priority", {"priority": 101}),
    ("seed", {"seed": -1}),
    ("name", {"name": "x" * 201}),
    ("labels", {"labels": {str(i): "" for i in range(33)}}),
    ("labels", {"labels": {"": "x"}}),
    ("labels.shot", {"labels": {"shot": "x" * 256}}),
    *(("webhook", {"webhook": url}) for url in ("ftp://a", "https://", "javascript:x", "http://a b", "http://[", "x")),
    ("webhook", {"webhook": "https://a:99999/"}),
]


@pytest.mark.parametrize(("field", "changes"), BAD)
def test_a_bad_request_is_refused_with_field_and_remedy(field: str, changes: dict[str, Any]) -> None:
    with pytest.raises(BadParameter) as refused:
        check_request(replace(GOOD, **changes), {"data": DATA})
    assert refused.value.field == field
    assert refused.value.remedy


@pytest.mark.parametrize(
    ("name", "asset"),
    [
        ("data", _asset("video")),
        ("reference", _asset("archive")),
        ("reference", _asset("json")),
        ("video", _asset("json")),
        ("mask", _asset("image")),
    ],
)
def test_an_asset_of_the_wrong_kind_is_refused(name: str, asset: Asset) -> None:
    with pytest.raises(BadParameter) as refused:
        check_request(GOOD, {"data": DATA, name: asset})
    assert refused.value.field == f"inputs.{name}"


@pytest.mark.parametrize(
    ("name", "asset"),
    [
        ("reference", _asset("image")),
        ("reference", _asset("video")),
        ("video", _asset("video")),
        ("video", _asset("archive")),
        ("video", _asset("image", frames=1)),
    ],
)
def test_an_asset_of_the_right_kind_is_accepted(name: str, asset: Asset) -> None:
    check_request(GOOD, {"data": DATA, name: asset})


def test_a_missing_input_is_named() -> None:
    with pytest.raises(BadParameter, match="missing") as refused:
        check_request(replace(GOOD, inputs={}), {})
    assert refused.value.field == "inputs.data"


def test_an_input_that_needs_another_is_refused_without_it() -> None:
    """Checked for a job of one method, and for a film, where the input of its second layer is named layer1.style."""
    video, image = _asset("video"), _asset("image")
    with pytest.raises(BadParameter, match="'style' needs the input 'style_output'") as refused:
        check_request(JobRequest("analogy", {}), {"video": video, "style": image})
    assert refused.value.field == "inputs.style_output"
    check_request(JobRequest("analogy", {}), {"video": video, "style": image, "style_output": image})
    film = JobRequest("layers", {}, params={"layers": [{"method": "abstraction"}, {"method": "analogy"}]})
    with pytest.raises(BadParameter, match="missing") as refused:
        check_request(film, {"video": video, "layer1.style": image})
    assert refused.value.field == "inputs.layer1.style_output"
