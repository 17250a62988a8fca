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


def test_the_entries_of_an_artefact(client: TestClient, job: str) -> None:
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
def test_entries_that_are_not_there(client: TestClient, farm: DrivenFarm, job: str, path: str) -> None:
    farm.finish(job, b"a film")
    answer = client.get(f"/v1/jobs/{job}/artefacts/{path}")
    assert answer.status_code in (404, 409)
    assert answer.json()["remedy"]


def test_the_list_and_the_maps_of_a_frame(client: TestClient, job: str) -> None:
    assert client.get(f"/v1/jobs/{job}/regions").json() == LISTED
    answer = client.get(f"/v1/jobs/{job}/regions/3")
    assert (answer.content, answer.headers["content-type"]) == (b"a map", "image/png")
    assert client.get(f"/v1/jobs/{job}/regions/3?kind=tubes").content == b"tubes"
    assert answer.headers["etag"] != client.get(f"/v1/jobs/{job}/regions/3?kind=tubes").headers["etag"]


@pytest.mark.parametrize("path", ["regions/4", "regions/-1", "regions/3?kind=colours", "regions/x"])
def test_what_is_not_there_is_refused(client: TestClient, job: str, path: str) -> None:
    answer = client.get(f"/v1/jobs/{job}/{path}")
    assert answer.status_code in (404, 422) and answer.json()["code"]


def test_a_job_without_regions_has_none(client: TestClient, farm: DrivenFarm, body: dict[str, Any]) -> None:
    made = client.post("/v1/jobs", json=body).json()["id"]
    assert client.get(f"/v1/jobs/{made}/regions").status_code == 409
    farm.finish(made)
    assert client.get(f"/v1/jobs/{made}/regions").status_code == 404
    assert client.get("/v1/jobs/job_none/regions").status_code == 404


def test_methods_publish_the_schemas_of_their_documents(client: TestClient) -> None:
    for schema in Multistyle.input_schemas.values():
        jsonschema.Draft202012Validator.check_schema(schema())
    answer = client.get("/v1/methods/toy/inputs/video/schema")
    assert (answer.status_code, answer.json()["code"]) == (404, "not-found")


def test_a_preview_takes_a_design_and_the_regions_of_a_job_that_one_may_see(
    client: TestClient, job: str, body: dict[str, Any]
) -> None:
    ask = {name: body[name] for name in ("method", "inputs")}
    answer = client.post("/v1/previews", json={**ask, "design": {"version": 1}, "regions_of": job})
    assert (answer.status_code, answer.headers["content-type"]) == (200, "image/png")
    assert client.post("/v1/previews", json={**ask, "artefacts_of": job}).status_code == 200
    for field in ("regions_of", "artefacts_of"):
        assert client.post("/v1/previews", json={**ask, field: "job_none"}).status_code == 404
