"""Entries of artefacts, with the deprecated routes for regions; schemas of documents; previews with a document."""

from __future__ import annotations

import io
import json
import zipfile
from typing import Any

import jsonschema
import pytest
from fastapi.testclient import TestClient

from pipeline.methods.multistyle import Multistyle
from tests.service.driven_farm import DrivenFarm

LISTED = {"version": 1, "regions": [{"number": 0, "name": "rest"}], "objects": [], "tubes": []}


@pytest.fixture
def job(client: TestClient, farm: DrivenFarm, body: dict[str, Any]) -> str:
    made: str = client.post("/v1/jobs", json=body).json()["id"]
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        archive.writestr("regions-list.json", json.dumps(LISTED))
        archive.writestr("map-0000003.png", b"a map")
        archive.writestr("tubes-0000003.png", b"tubes")
    farm.add_file(made, "regions", out.getvalue(), "application/zip")
    return made


def test_entries_of_an_artefact_are_listed_and_served(client: TestClient, job: str) -> None:
    at = f"/v1/jobs/{job}/artefacts/regions"
    rows = client.get(at).json()["items"]
    assert [row["name"] for row in rows] == ["regions-list.json", "map-0000003.png", "tubes-0000003.png"]
    assert [row["size_bytes"] for row in rows][1:] == [5, 5]
    for row in rows:
        answer = client.get(row["url"])
        assert (answer.status_code, answer.headers["content-type"]) == (200, row["media_type"])
        assert len(answer.content) == row["size_bytes"]
        assert "immutable" in answer.headers["cache-control"]


@pytest.mark.parametrize("path", ["regions/none.png", "svg/0.svg", "result"])
def test_missing_artefact_entries_are_404(client: TestClient, farm: DrivenFarm, job: str, path: str) -> None:
    farm.finish(job, b"a film")
    answer = client.get(f"/v1/jobs/{job}/artefacts/{path}")
    assert answer.status_code in (404, 409)
    assert answer.json()["remedy"]


def test_methods_publish_the_schemas_of_their_documents(client: TestClient) -> None:
    for schema in Multistyle.input_schemas.values():
        jsonschema.Draft202012Validator.check_schema(schema())
    answer = client.get("/v1/methods/toy/inputs/video/schema")
    assert (answer.status_code, answer.json()["code"]) == (404, "not-found")


def test_a_preview_accepts_documents_and_the_regions_of_an_accessible_job(
    client: TestClient, job: str, body: dict[str, Any]
) -> None:
    ask = {name: body[name] for name in ("method", "inputs")}
    answer = client.post("/v1/previews", json={**ask, "documents": {"plan": {"version": 1}}, "artefacts_of": job})
    assert (answer.status_code, answer.headers["content-type"]) == (200, "image/png")
    assert client.post("/v1/previews", json={**ask, "artefacts_of": "job_none"}).status_code == 404


def test_examples_of_a_design_are_sound_and_as_long_as_the_video(client: TestClient) -> None:
    found: dict[str, Any] = dict(Multistyle.input_examples["design"](90))
    assert set(found) == {"rack-focus", "emphasis", "calm-to-stress"}
    for document in found.values():
        jsonschema.validate(document, Multistyle.input_schemas["design"]())
    assert max(key["frame"] for key in found["calm-to-stress"]["keys"]) == 89
    at = "/v1/methods/toy/inputs/video/examples"
    assert client.get(at, params={"frames": 0}).status_code == 422
    missing = client.get(at, params={"frames": 9})
    assert missing.status_code == 404 and missing.json()["remedy"] == "There are: none."
