"""The project document: invalid ones are refused, with the location of every fault."""

from __future__ import annotations

import pickle
from typing import Any

import pytest

from tests.workers.projects.documents import ASSETS, DESIGNED, document, layer
from workers.projects.checking import problems
from workers.projects.document import empty, json_schema
from workers.projects.faults import BadProject
from workers.projects.parsing import parse_document
from workers.projects.patching import BadPatch, merged, patched


def _paths(value: Any) -> list[str]:
    with pytest.raises(BadProject) as caught:
        parse_document(value)
    return [fault.path for fault in caught.value.errors]


def _problems(value: Any) -> list[str]:
    return [problem.path for problem in problems(parse_document(value), ASSETS)]


def test_an_empty_document_is_valid() -> None:
    assert parse_document(empty("Swan")).shots == ()


def test_all_structural_errors_are_reported_together_with_their_paths() -> None:
    wrong = document(
        layer("multistyle", opacity=2, brush=1, keys=[{"frame": -1, "image": "key-12"}]), output={"format": "avi"}
    )
    assert _paths(wrong) == [
        "/shots/0/layers/0/opacity",
        "/shots/0/layers/0/parts/keys/0/frame",
        "/shots/0/layers/0/brush",
        "/output/format",
    ]


def test_references_and_ids_of_a_document_are_checked() -> None:
    keys = [{"frame": 1, "image": "nobody"}, {"frame": 1, "image": "key-12", "mask": "none"}]
    wrong = document(
        layer("analogy", keys=keys, inputs={"style_output": "ghost"}), layer("analogy"),
        variants=[{"id": "v", "shot": "s9", "layer": "l1"}, {"id": "w", "shot": "s1", "layer": "l7"}],
    )  # fmt: skip
    assert sorted(_paths(wrong)) == [
        "/shots/0/layers/0/inputs/style_output",
        "/shots/0/layers/0/parts/keys/0/image",
        "/shots/0/layers/0/parts/keys/1/frame",
        "/shots/0/layers/0/parts/keys/1/mask",
        "/shots/0/layers/1/id",
        "/variants/0/shot",
        "/variants/1/layer",
    ]


def test_a_document_error_can_be_pickled() -> None:
    with pytest.raises(BadProject) as caught:
        parse_document({"schema": 3})
    again = pickle.loads(pickle.dumps(caught.value))
    assert again.errors == caught.value.errors and str(again) == str(caught.value)


def test_json_pointers_escape_names() -> None:
    assert _paths(document(layer("analogy", inputs={"a/b~c": "wave"})))[0] == "/shots/0/layers/0/inputs/a~1b~0c"


@pytest.mark.parametrize(
    ("parts", "paths"),
    [
        ({"method": "oil"}, ["/method"]),
        ({"params": {"stroke_size": 9, "colour": 1}}, ["/params/stroke_size", "/params/colour"]),
        ({"parts": {"design": {"keys": [{"region": "moon", "frame": 3}, {"region": "rest", "frame": 24}]}}},
         ["/parts/design/keys/0/region", "/parts/design/keys/1/frame"]),
        ({"parts": {"design": {"regions": {"swan": {"label": 1}}}}}, ["/parts/design/regions/swan/label"]),
        ({"parts": {"region_maps": [{"frame": 24, "image": "map-0"}]}}, ["/parts/region_maps/0/frame"]),
        ({"parts": {"region_maps": [{"frame": 0, "image": "clip"}]}}, ["/parts/region_maps/0/image"]),
        ({"method": "analogy", "inputs": {"style": "wave"}}, ["/inputs/style_output"]),
        ({"method": "steady"}, ["/inputs/styled"]),
    ],
)  # fmt: skip
def test_problems_are_reported_with_their_path(parts: dict[str, Any], paths: list[str]) -> None:
    assert _problems(document(layer("multistyle") | parts)) == [f"/shots/0/layers/0{path}" for path in paths]


def test_a_designed_layer_has_no_problems() -> None:
    assert _problems(document(DESIGNED)) == []


def test_a_deleted_asset_is_reported_at_every_use() -> None:
    parsed = parse_document(document(layer("analogy", keys=[{"frame": 12, "image": "key-12"}])))
    kept = {key: value for key, value in ASSETS.items() if key != parsed.assets["key-12"].id}
    assert [problem.path for problem in problems(parsed, kept)] == ["/shots/0/layers/0/parts/keys/0/image"]


def test_a_hidden_layer_may_have_problems() -> None:
    assert _problems(document(DESIGNED, layer("oil", id="l2", visible=False))) == []


def test_the_ui_member_accepts_any_content() -> None:
    parse_document(document(layer("patches", ui={"open": ["style"], "x": None}), ui={"zoom": 2}))


def test_a_patch_is_applied_atomically() -> None:
    before = document(DESIGNED)
    after = patched(before, [{"op": "add", "path": "/shots/0/layers/0/seed", "value": 4}])
    assert after["shots"][0]["layers"][0]["seed"] == 4 and "seed" not in before["shots"][0]["layers"][0]
    for wrong in ([{"op": "remove", "path": "/nothing"}], [{"op": "test", "path": "/name", "value": "x"}], {}, [3]):
        with pytest.raises(BadPatch):
            patched(before, wrong)


def test_merge_patch_matches_the_examples_of_rfc_7396() -> None:
    cases: list[tuple[Any, Any, Any]] = [
        ({"a": "b"}, {"a": "c"}, {"a": "c"}),
        ({"a": "b", "b": "c"}, {"a": None}, {"b": "c"}),
        ({"a": {"b": "c"}}, {"a": {"b": "d", "c": None}}, {"a": {"b": "d"}}),
        ({"a": [{"b": "c"}]}, {"a": [1]}, {"a": [1]}),
        ({"e": None}, {"a": 1}, {"e": None, "a": 1}),
        ([1, 2], {"a": "b", "c": None}, {"a": "b"}),
        ({}, {"a": {"bb": {"ccc": None}}}, {"a": {"bb": {}}}),
    ]
    for target, patch, result in cases:
        assert merged(target, patch) == result


def test_the_schema_names_every_member() -> None:
    assert {"schema", "name", "assets", "shots", "variants", "output", "ui"} == set(json_schema()["properties"])
