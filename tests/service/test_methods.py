"""GET /v1/methods."""

from __future__ import annotations

from xml.etree import ElementTree

from fastapi.testclient import TestClient


def test_a_method_description_contains_everything_for_a_form(client: TestClient) -> None:
    found = client.get("/v1/methods/toy").json()
    assert found["params_schema"]["properties"]["sigma_px"] == {
        "default": 1.5,
        "maximum": 10,
        "minimum": 0,
        "symbol": "sigma",
        "title": "Sigma Px",
        "type": "number",
        "unit": "px",
    }
    assert found["defaults"] == {"sigma_px": 1.5, "mode": "soft", "lines": True}
    assert [spec["name"] for spec in found["inputs"]] == ["video"]
    assert found["steps"] == [{"name": "paint", "title": "Paint"}]
    assert found["examples"][0]["params"] == {"mode": "hard"}
    assert client.get("/v1/methods").json() == {"items": [found], "cursor": None}


def test_the_thumbnail_is_an_image_for_every_title(client: TestClient) -> None:
    answer = client.get("/v1/methods/toy/thumbnail")
    assert answer.headers["content-type"].startswith("image/svg+xml")
    assert ElementTree.fromstring(answer.content).tag.endswith("svg")


def test_an_unknown_method_is_404_with_the_known_names(client: TestClient) -> None:
    answer = client.get("/v1/methods/oil")
    assert (answer.status_code, answer.json()["code"]) == (404, "not-found")
    assert "toy" in answer.json()["remedy"]
