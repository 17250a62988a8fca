"""Documents of schema 1 give the jobs that version 0f33145d, which wrote them, made of them.

`schema_1.json` holds documents with every part, and the submissions of that version, with the bytes of their JSON.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from workers.farm import Farm
from workers.projects.document import SCHEMA, Layer
from workers.projects.faults import BadProject
from workers.projects.materials import ImagesByFrame, JsonValue, Material, Uploaded
from workers.projects.parsing import parse_document
from workers.projects.patching import BadPatch, patched
from workers.projects.submissions import Selection, submissions
from workers.projects.upgrades import moved, upgraded
from workers.store.projects import Draft

CASES: dict[str, Any] = json.loads(Path(__file__).with_name("schema_1.json").read_text())


def _written(material: Material) -> Any:
    if isinstance(material, Uploaded):
        return material.asset_id
    if isinstance(material, JsonValue):
        return {"json": material.text}
    assert isinstance(material, ImagesByFrame)
    return {"images": [list(image) for image in material.images]}


def _jobs(document: dict[str, Any]) -> list[dict[str, Any]]:
    chosen = Selection(variants=[one["id"] for one in document.get("variants", [])])
    return [
        {"method": one.method, "params": one.params, "seed": one.seed, "frames": one.frames and list(one.frames),
         "inputs": {name: _written(material) for name, material in one.inputs.items()}}
        for one in submissions(parse_document(document), chosen)
    ]  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_a_document_of_schema_1_gives_the_jobs_of_its_version(name: str) -> None:
    assert _jobs(CASES[name]["document"]) == CASES[name]["jobs"]
    assert _jobs(upgraded(CASES[name]["document"])) == CASES[name]["jobs"]


@pytest.mark.parametrize("name", CASES)
def test_an_upgraded_document_is_of_the_present_schema_and_stays_as_it_is(name: str) -> None:
    once = upgraded(CASES[name]["document"])
    assert once["schema"] == SCHEMA and upgraded(once) == once
    assert set(once["shots"][0]["layers"][0]) <= Layer.model_fields.keys()


def test_every_stored_version_is_read_in_the_present_schema(farm: Farm) -> None:
    """Versions that earlier programs have stored."""
    old = CASES["designed"]["document"]
    project = farm.projects._store.create(Draft(old, "Swan", (), ""), "")
    renamed = {**old, "name": "Goose"}
    farm.projects._store.save(project.id, 1, Draft(renamed, "Goose", (), ""))
    for version, document in ((1, old), (2, renamed), (None, renamed)):
        assert farm.projects.document(project.id, version)[1] == upgraded(document)


def test_what_a_client_sends_in_schema_1_is_stored_in_the_present_one(farm: Farm) -> None:
    project = farm.projects.create(CASES["keyed"]["document"], "")
    assert farm.projects.document(project.id)[1] == upgraded(CASES["keyed"]["document"])


FORMER = [
    ("/shots/0/layers/0/keys/-", "/shots/0/layers/0/parts/keys/-"),
    ("/shots/0/layers/0/style_keys/3/ease", "/shots/0/layers/0/parts/design/keys/3/ease"),
    ("/shots/0/layers/0/regions", "/shots/0/layers/0/parts/design/regions"),
    ("/shots/2/layers/1/region_maps", "/shots/2/layers/1/parts/region_maps"),
    ("/variants/0/set/histogram", "/variants/0/set/parts/histogram"),
]


@pytest.mark.parametrize(("former", "present"), FORMER)
def test_a_patch_of_a_former_place_is_refused_with_the_present_one(former: str, present: str) -> None:
    document = upgraded(CASES["designed"]["document"])
    for operation in (
        {"op": "add", "path": former, "value": []}, {"op": "remove", "path": former},
        {"op": "move", "from": former, "path": "/ui/x"}, {"op": "test", "path": former, "value": 1},
    ):  # fmt: skip
        with pytest.raises(BadPatch) as caught:
            patched(document, [{"op": "test", "path": "/name", "value": "Swan"}, operation])
        assert caught.value.field in ("body.1.path", "body.1.from") and caught.value.value == former
        assert caught.value.remedy == f"Use {present}."


def test_only_former_members_of_layers_have_moved() -> None:
    for pointer in ("", "/shots/0/layers/0/parts/keys", "/shots/0/layers/0/params/styles", "/ui/styles", "/labels"):
        assert moved(pointer) == ""


def test_a_former_member_is_refused_with_its_present_place() -> None:
    document = upgraded(CASES["keyed"]["document"])
    document["shots"][0]["layers"][0]["scribbles"] = []
    variant = {"id": "v", "shot": "s1", "layer": "l1", "set": {"style_keys": []}}
    with pytest.raises(BadProject) as caught:
        parse_document(document)
    assert [(one.path, one.remedy) for one in caught.value.errors] == [
        ("/shots/0/layers/0/scribbles", "Use /shots/0/layers/0/parts/scribbles.")
    ]
    del document["shots"][0]["layers"][0]["scribbles"]
    with pytest.raises(BadProject) as caught:
        submissions(parse_document({**document, "variants": [variant]}), Selection(variants=["v"]))
    assert caught.value.errors[0].remedy == "Use /variants/0/set/parts/design/keys."


@pytest.mark.parametrize("damage", [{"shots": 3}, {"shots": [3]}, {"shots": [{"layers": {}}]}, {"variants": [None]}])
def test_a_malformed_document_of_schema_1_is_refused_as_any_other(damage: dict[str, Any]) -> None:
    with pytest.raises(BadProject):
        parse_document({**CASES["keyed"]["document"], **damage})
