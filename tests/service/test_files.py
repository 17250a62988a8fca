"""Files of jobs and assets: ranges, tags, HEAD, names, and no script in our origin."""

from __future__ import annotations

import pytest
from fastapi.testclient import TestClient

from service.serving import disposition
from tests.service.conftest import CLIP
from tests.service.driven_farm import DrivenFarm

BYTES = b"0123456789"


@pytest.fixture
def result(client: TestClient, farm: DrivenFarm, job: str) -> str:
    farm.finish(job, BYTES)
    return f"/v1/jobs/{job}/result"


def test_an_unfinished_result_is_409(client: TestClient, job: str) -> None:
    assert client.get(f"/v1/jobs/{job}/result").json()["code"] == "conflict"


def test_a_file_is_served_completely(client: TestClient, result: str) -> None:
    answer = client.get(result)
    assert (answer.status_code, answer.content) == (200, BYTES)
    assert answer.headers["content-type"] == "video/mp4"
    assert answer.headers["accept-ranges"] == "bytes"
    assert answer.headers["content-disposition"] == 'inline; filename="impasto-toy.mp4"'
    assert "sandbox" in answer.headers["content-security-policy"]
    assert client.get(result, params={"download": "true"}).headers["content-disposition"].startswith("attachment")


@pytest.mark.parametrize(
    ("asked", "first", "last"),
    [
        ("bytes=0-0", 0, 0),
        ("bytes=2-5", 2, 5),
        ("bytes=7-", 7, 9),
        ("bytes=-3", 7, 9),
        ("bytes=-300", 0, 9),
        ("bytes=5-999", 5, 9),
    ],
)
def test_a_range_of_a_file_is_served(client: TestClient, result: str, asked: str, first: int, last: int) -> None:
    answer = client.get(result, headers={"Range": asked})
    assert (answer.status_code, answer.content) == (206, BYTES[first : last + 1])
    assert answer.headers["content-range"] == f"bytes {first}-{last}/10"
    assert answer.headers["content-length"] == str(last + 1 - first)


@pytest.mark.parametrize("asked", ["bytes=10-", "bytes=-0", "bytes=99-100"])
def test_an_unsatisfiable_range_is_416(client: TestClient, result: str, asked: str) -> None:
    answer = client.get(result, headers={"Range": asked})
    assert (answer.status_code, answer.json()["code"]) == (416, "range-not-satisfiable")
    assert answer.headers["content-range"] == "bytes */10"


@pytest.mark.parametrize("asked", ["bytes=5-2", "bytes=-", "pages=1-2", "bytes=0-1,4-5", "bytes=a-b"])
def test_an_ignorable_range_gives_the_complete_file(client: TestClient, result: str, asked: str) -> None:
    answer = client.get(result, headers={"Range": asked})
    assert (answer.status_code, answer.content) == (200, BYTES)


def test_etags_validate_conditional_requests(client: TestClient, result: str) -> None:
    tag = client.get(result).headers["etag"]
    fresh = client.get(result, headers={"If-None-Match": f'"other", W/{tag}'})
    assert (fresh.status_code, fresh.content) == (304, b"")
    assert client.get(result, headers={"Range": "bytes=0-1", "If-Range": tag}).status_code == 206
    assert client.get(result, headers={"Range": "bytes=0-1", "If-Range": '"other"'}).status_code == 200


def test_a_head_request_gives_length_without_body(client: TestClient, result: str) -> None:
    answer = client.head(result)
    assert (answer.status_code, answer.content, answer.headers["content-length"]) == (200, b"", "10")


def test_listed_file_links_can_be_fetched(client: TestClient, farm: DrivenFarm, result: str) -> None:
    (row,) = client.get(result.replace("/result", "/files")).json()["items"]
    assert (row["name"], row["size_bytes"], row["media_type"]) == ("result", 10, "video/mp4")
    assert client.get(row["url"]).content == BYTES


@pytest.mark.parametrize("name", ["..%2fsecret", "%00", "a%20b", ".hidden"])
def test_an_invalid_file_name_is_refused(client: TestClient, job: str, name: str) -> None:
    assert client.get(f"/v1/jobs/{job}/files/{name}").status_code in (404, 422)


def test_the_content_of_an_asset_is_served(client: TestClient, asset: str) -> None:
    answer = client.get(f"/v1/assets/{asset}/content", headers={"Range": "bytes=4-"})
    assert (answer.status_code, answer.content) == (206, CLIP[4:])


@pytest.mark.parametrize(
    ("name", "header"),
    [
        ("a.mp4", 'inline; filename="a.mp4"'),
        ('a"\r\nX: y.mp4', "inline; filename=\"a___X_ y.mp4\"; filename*=UTF-8''a%22%0D%0AX%3A%20y.mp4"),
        ("é.mp4", "inline; filename=\"_.mp4\"; filename*=UTF-8''%C3%A9.mp4"),
    ],
)
def test_file_names_cannot_break_the_content_disposition_header(name: str, header: str) -> None:
    assert disposition(name, attachment=False) == header
