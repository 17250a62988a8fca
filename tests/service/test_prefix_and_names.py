"""Behind a path prefix; file names of all systems; options of image sequences that are given with an upload."""

from __future__ import annotations

import base64
import io
import zipfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from fastapi.testclient import TestClient

from pipeline.video.stills import encode_png
from service.app import create_app
from service.prefix import with_prefix
from service.settings import Settings
from workers.farm import open_farm

PREFIX = {"X-Forwarded-Prefix": "/paint"}
NAMES = [
    "Screen Recording 2026-11-28 at 5.40.12\u202fPM.mov", "Épisode 1\u00a0: forêt.mp4", "動画\u3000１.mp4",
    "family \U0001f468\u200d\U0001f469\u200d\U0001f467.mp4", "می\u200cخواهم.mp4", "e\u0301te\u0301.mp4",
    "\u200fשלום.mp4",
    "Fuß\u00adball.mp4", "12\u2009fps.mp4", "\ufeffclip.mp4", "take\uf022 1.mp4", "\U0001fae8.mp4", "~x.mp4", "-i.mp4",
    "100%25 %d.mp4", "it's \"q\".mp4", "\U000e0067 flag.mp4", "١٢٣.mp4",
]  # fmt: skip
REFUSED = [
    "two\nlines.mp4",
    "tab\there.mp4",
    "a/b.mp4",
    "a\\b.mp4",
    "",
    "..",
    "x" * 256,
    "nul\0.mp4",
    "\x9b.mp4",
    "\u2028",
]


def still() -> bytes:
    return encode_png(np.random.default_rng(0).integers(0, 256, (32, 48, 3)).astype(np.uint8))


def zipped(numbers: tuple[int, ...]) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        for number in numbers:
            archive.writestr(zipfile.ZipInfo(f"f.{number:04d}.png"), still())
    return out.getvalue()


def tus(client: TestClient, name: str, data: bytes, prefix: str = "", **more: str) -> tuple[int, dict[str, str]]:
    values = {"filename": name, **more}
    metadata = ",".join(f"{key} {base64.b64encode(value.encode()).decode()}" for key, value in values.items())
    head = {"Tus-Resumable": "1.0.0", "Upload-Length": str(len(data)), "Upload-Metadata": metadata}
    made = client.post("/v1/uploads", headers=head | ({"X-Forwarded-Prefix": prefix} if prefix else {}))
    return made.status_code, dict(made.headers)


@pytest.fixture
def client(home: Path) -> Iterator[TestClient]:
    farm = open_farm(Settings(home=home, pool="none"))
    with TestClient(create_app(Settings(home=home, pool="none"), farm), "http://127.0.0.1:8420") as opened:
        yield opened
    farm.stop()


@pytest.mark.parametrize("name", NAMES)
def test_names_of_all_systems_are_given_back_unchanged(client: TestClient, name: str) -> None:
    found = client.post("/v1/assets", files={"file": (name, still(), "image/png")})
    assert found.status_code in (200, 201) and found.json()["filename"].replace("%22", '"') == name
    assert tus(client, name, still())[0] == 201


@pytest.mark.parametrize("name", REFUSED)
def test_control_characters_and_separators_are_refused(client: TestClient, name: str) -> None:
    status, _ = tus(client, name, still()) if name else (422, {})
    assert status == 422


def test_pages_are_behind_the_prefix(client: TestClient) -> None:
    page = client.get("/docs", headers=PREFIX).text
    assert 'href="/paint/docs/docs.css"' in page and '"/docs' not in page
    assert client.get("/docs").text == with_prefix(client.get("/docs").text, "")
    assert client.get("/paint/docs", headers=PREFIX).text == page  # a proxy that leaves the prefix
    moved = client.get("/shared/abc", headers=PREFIX, follow_redirects=False)
    assert moved.headers["location"] == "/paint/#/shared/abc"


def test_the_openapi_document_names_the_prefix(client: TestClient) -> None:
    servers = [server["url"] for server in client.get("/openapi.json", headers=PREFIX).json()["servers"]]
    assert servers[0] == "/paint"
    assert client.get("/openapi.json").json()["servers"][0]["url"] == "/"


@pytest.mark.parametrize("path", ["/v1/uploads", "/paint/v1/uploads"])
def test_a_tus_client_finds_its_upload(client: TestClient, path: str) -> None:
    data = still()
    head = {"Tus-Resumable": "1.0.0", "Upload-Length": str(len(data)), **PREFIX}
    location = client.post(path, headers=head).headers["location"]
    assert location.startswith("/paint/v1/uploads/")
    more = {"Tus-Resumable": "1.0.0", "Upload-Offset": "0", "Content-Type": "application/offset+octet-stream", **PREFIX}
    done = client.patch(location, headers=more, content=data)
    assert done.status_code == 204 and done.headers["impasto-asset"].startswith("ast_")
    assert client.get(f"/paint/v1/assets/{done.headers['impasto-asset']}", headers=PREFIX).status_code == 200


@pytest.mark.parametrize("asked", ["/v1/jobs", "/paint/v1/jobs"])
def test_addresses_in_answers_are_behind_the_prefix(asked: str, client: TestClient) -> None:
    video = client.post("/v1/assets", files={"file": ("s.png", still())}).json()["id"]
    job = client.post(asked, json={"method": "abstraction", "inputs": {"video": video}}, headers=PREFIX)
    links = job.json()["links"]
    assert job.headers["location"] == links["self"] and links["self"].startswith("/paint/v1/jobs/")
    assert {each.split("/")[1] for each in links.values()} == {"paint"}
    assert client.get(links["self"], headers=PREFIX).json()["links"] == links
    (listed,) = client.get(asked, headers=PREFIX).json()["items"]
    assert listed["links"] == links
    document = {"schema": 1, "name": "P"}
    project = client.post("/v1/projects", json={"document": document}, headers=PREFIX).json()
    assert all(each.startswith("/paint/v1/projects/") for each in project["links"].values())
    plain = client.get(f"/v1/jobs/{job.json()['id']}").json()["links"]
    assert plain["self"] == links["self"].removeprefix("/paint")


@pytest.mark.parametrize("prefix", ["//evil.example", '/a"><script>', "/../x", "javascript:x", "/a b", "/" * 9])
def test_a_prefix_that_is_no_path_is_ignored(client: TestClient, prefix: str) -> None:
    assert client.get("/docs", headers={"X-Forwarded-Prefix": prefix}).text == client.get("/docs").text


def test_options_of_a_sequence_come_with_the_upload(client: TestClient) -> None:
    data = zipped((1001, 1002, 1004))
    plain = client.post("/v1/assets", files={"file": ("f.zip", data)}).json()
    assert "1003" in plain["info"]["fault"]["message"] and plain["info"]["numbers"] == [
        [1001, 1002, 1],
        [1004, 1004, 1],
    ]
    held = client.post("/v1/assets?missing=hold&fps=24000/1001", files={"file": ("f.zip", data)}).json()
    assert (held["info"]["frames"], held["info"]["fault"], round(held["info"]["fps"], 3)) == (4, {}, 23.976)
    assert held["id"] != plain["id"]
    _, headers = tus(client, "f.zip", data, missing="hold", fps="24000/1001")
    more = {"Tus-Resumable": "1.0.0", "Upload-Offset": "0", "Content-Type": "application/offset+octet-stream"}
    assert client.patch(headers["location"], headers=more, content=data).headers["impasto-asset"] == held["id"]
    job = {"method": "abstraction", "inputs": {"video": plain["id"]}}
    refused = client.post("/v1/jobs", json=job)
    assert refused.status_code == 422 and "1003" in refused.json()["detail"]
    assert refused.json()["field"] == "inputs.video"


@pytest.mark.parametrize("query", ["missing=guess", "fps=0", "fps=fast", "view=left"])
def test_wrong_options_are_refused(client: TestClient, query: str) -> None:
    assert client.post(f"/v1/assets?{query}", files={"file": ("f.zip", zipped((1, 2)))}).status_code == 422


def test_keys_that_fit_no_frame_are_refused_with_the_valid_numbers(client: TestClient) -> None:
    film, keys = (client.post("/v1/assets", files={"file": ("f.zip", zipped(numbers))}).json()["id"]
                  for numbers in (tuple(range(1001, 1013)), (1001, 13)))  # fmt: skip
    job = {"method": "patches", "inputs": {"video": film, "masks": keys}}
    refused = client.post("/v1/jobs", json=job)
    assert refused.status_code == 422 and "1001 to 1012" in refused.text and "13" in refused.json()["value"]
