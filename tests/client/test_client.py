"""The client against a small in-memory service that fails as networks do."""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest

from impasto_client import Client
from impasto_client.errors import JobFailed, NotAllowed, ServiceUnreachable
from impasto_client.events import Parser
from impasto_client.files import asset_id_of
from pipeline.errors import BadParameter, ImpastoError, UnreadableMedia
from workers.errors import NotFound

Handler = Callable[[httpx.Request], httpx.Response]


@pytest.fixture(autouse=True)
def no_waiting(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(time, "sleep", lambda seconds: None)


def client(handler: Handler) -> Client:
    return Client("http://service.test", api_key="secret", transport=httpx.MockTransport(handler))


def problem(status: int, **parts: Any) -> httpx.Response:
    return httpx.Response(status, json=parts, headers={"Content-Type": "application/problem+json"})


class LiveStream(httpx.SyncByteStream):
    """A stream of bytes that can end with a broken connection."""

    def __init__(self, data: bytes, breaks: bool = False) -> None:
        self.data, self.breaks = data, breaks

    def __iter__(self) -> Iterator[bytes]:
        yield self.data
        if self.breaks:
            raise httpx.ReadError("the cable was cut")


# -- problems


@pytest.mark.parametrize(
    ("status", "code", "kind"),
    [
        (422, "bad-parameter", BadParameter),
        (422, "unreadable-media", UnreadableMedia),
        (404, "not-found", NotFound),
        (401, "unauthorized", NotAllowed),
        (403, "forbidden", NotAllowed),
        (500, "internal-error", ImpastoError),
        (460, "brand-new-code", ImpastoError),
    ],
)
def test_a_problem_document_becomes_the_error_with_its_code(status: int, code: str, kind: type[ImpastoError]) -> None:
    answer = problem(status, code=code, detail="It is wrong.", field="params.x", value="9", remedy="Mend it.")
    with client(lambda request: answer) as impasto, pytest.raises(kind) as caught:
        impasto.job("job_1")
    error = caught.value
    assert (error.code, error.field, error.value, error.remedy) == (code, "params.x", "9", "Mend it.")
    assert type(error) is kind


def test_an_error_answer_without_problem_document_raises() -> None:
    with (
        client(lambda request: httpx.Response(502, text="<html>")) as impasto,
        pytest.raises(ImpastoError, match="502"),
    ):
        impasto.job("job_1")


def test_an_unreachable_address_raises_service_unreachable() -> None:
    def refuse(request: httpx.Request) -> httpx.Response:
        raise httpx.ConnectError("refused")

    with client(refuse) as impasto, pytest.raises(ServiceUnreachable) as caught:
        impasto.methods()
    assert caught.value.value == "http://service.test"
    assert "impasto serve" in caught.value.remedy


def test_requests_carry_the_key_and_submissions_an_idempotency_key() -> None:
    requests: list[httpx.Request] = []

    def accept(request: httpx.Request) -> httpx.Response:
        requests.append(request)
        return httpx.Response(201, json={"id": "job_1"})

    with client(accept) as impasto:
        impasto.submit("abstraction", {"video": "ast_1"}, {"lines": "off"}, seed=3)
    assert requests[0].headers["Authorization"] == "Bearer secret"
    assert len(requests[0].headers["Idempotency-Key"]) == 32
    body = json.loads(requests[0].content)
    assert body == {"method": "abstraction", "inputs": {"video": "ast_1"}, "params": {"lines": "off"}, "seed": 3}


# -- events


def test_events_are_parsed_and_an_incomplete_one_is_dropped() -> None:
    text = ': hello\n\nid: 7\nevent: log\ndata: {"a":\ndata: 1}\n\nid: 8\ndata: half'
    parser = Parser()
    found = [event for line in text.split("\n") for event in parser.line(line)]
    assert found[0] is None
    assert [(e.seq, e.type, e.data) for e in found if e] == [(7, "log", {"a": 1})]


class Jobs:
    """A job that advances each time it is read; its event stream breaks after each event."""

    def __init__(self, states: list[str], stream: bool = True) -> None:
        self.states, self.stream, self.asked, self.last_ids = states, stream, 0, list[str | None]()

    def __call__(self, request: httpx.Request) -> httpx.Response:
        if request.url.path.endswith("/events"):
            return self._events(request.headers.get("Last-Event-ID"))
        state = self.states[min(self.asked, len(self.states) - 1)]
        self.asked += 1
        error = {"code": "unreadable-media", "message": "Bad.", "remedy": "Good.", "field": "video", "value": None}
        return httpx.Response(
            200, json={"state": state, "n": self.asked, "error": error if state == "failed" else None}
        )

    def _events(self, last: str | None) -> httpx.Response:
        self.last_ids.append(last)
        if not self.stream:
            return httpx.Response(200, text="not a stream", headers={"Content-Type": "text/plain"})
        text = f"id: {int(last or 0) + 1}\nevent: job.state\ndata: {{}}\n\n"
        return httpx.Response(
            200, stream=LiveStream(text.encode(), breaks=True), headers={"Content-Type": "text/event-stream"}
        )


def test_wait_reconnects_from_the_last_event() -> None:
    jobs = Jobs(["queued", "running", "running", "running", "running", "succeeded"])
    with client(jobs) as impasto:
        assert impasto.wait("job_1")["state"] == "succeeded"
    assert jobs.last_ids[:3] == [None, "1", "2"]


def test_wait_polls_without_an_event_stream() -> None:
    jobs = Jobs(["queued", "running", "running", "succeeded"], stream=False)
    with client(jobs) as impasto:
        assert impasto.wait("job_1")["state"] == "succeeded"
    assert len(jobs.last_ids) == 1


def test_wait_raises_the_error_of_the_job() -> None:
    with client(Jobs(["running", "failed"])) as impasto, pytest.raises(JobFailed) as caught:
        impasto.wait("job_1")
    assert (caught.value.code, caught.value.remedy, caught.value.job["state"]) == (
        "unreadable-media",
        "Good.",
        "failed",
    )


def test_wait_ends_at_its_time_limit() -> None:
    with client(Jobs(["running"])) as impasto, pytest.raises(TimeoutError):
        impasto.wait("job_1", timeout_s=0.0)


# -- files


class Tus:
    """A tus 1.0.0 server in memory that takes only part of some pieces and drops the connection."""

    def __init__(self, cuts: int) -> None:
        self.data, self.cuts, self.name = b"", cuts, ""

    def __call__(self, request: httpx.Request) -> httpx.Response:
        if request.url.path.startswith("/v1/assets/"):
            known = request.url.path.endswith(f"ast_{hashlib.sha256(self.data).hexdigest()}") and self.data
            return httpx.Response(200, json={"id": request.url.path[11:]}) if known else problem(404, code="not-found")
        return getattr(self, f"_{request.method.lower()}")(request)

    def _post(self, request: httpx.Request) -> httpx.Response:
        self.name = request.headers["Upload-Metadata"]
        assert request.url.path == "/v1/uploads"
        return httpx.Response(201, headers={"Location": "/v1/uploads/u1"})

    def _head(self, request: httpx.Request) -> httpx.Response:
        return httpx.Response(200, headers={"Upload-Offset": str(len(self.data))})

    def _patch(self, request: httpx.Request) -> httpx.Response:
        assert request.url.path == "/v1/uploads/u1"
        assert int(request.headers["Upload-Offset"]) == len(self.data)
        piece = request.read()
        if self.cuts:
            self.cuts -= 1
            self.data += piece[: len(piece) // 2]
            raise httpx.WriteError("the cable was cut")
        self.data += piece
        return httpx.Response(204, headers={"Upload-Offset": str(len(self.data))})


@pytest.fixture
def large(tmp_path: Path) -> Path:
    path = tmp_path / "clip.mp4"
    path.write_bytes(bytes(range(256)) * (9 << 12))  # 9 MiB
    return path


def test_a_large_upload_over_a_bad_connection_is_complete_and_sent_once(large: Path) -> None:
    service, reports = Tus(cuts=3), list[tuple[int, int]]()
    with client(service) as impasto:
        asset = impasto.upload(large, lambda done, total: reports.append((done, total)))
        service.cuts = 99
        assert impasto.upload(large) == asset
    assert service.data == large.read_bytes()
    assert service.name == "filename Y2xpcC5tcDQ="
    assert reports[-1] == (9 << 20, 9 << 20)


def test_an_upload_fails_after_many_interruptions(large: Path) -> None:
    with client(Tus(cuts=99)) as impasto, pytest.raises(ServiceUnreachable, match="broke 6 times"):
        impasto.upload(large)


def test_a_download_resumes_by_range_and_restarts_after_a_change(tmp_path: Path) -> None:
    asked: list[tuple[str | None, str | None]] = []

    def serve(request: httpx.Request) -> httpx.Response:
        asked.append((request.headers.get("Range"), request.headers.get("If-Range")))
        if len(asked) == 1:
            return httpx.Response(200, stream=LiveStream(b"old", breaks=True), headers={"ETag": '"1"'})
        if len(asked) == 2:  # another file now: the whole of it, cut off again
            return httpx.Response(200, stream=LiveStream(b"new", breaks=True), headers={"ETag": '"2"'})
        return httpx.Response(206, stream=LiveStream(b"er"), headers={"ETag": '"2"'})

    target = tmp_path / "out.mp4"
    with client(serve) as impasto:
        impasto.download("job_1", target)
    assert target.read_bytes() == b"newer"
    assert asked == [(None, None), ("bytes=3-", '"1"'), ("bytes=3-", '"2"')]


def test_a_failed_download_leaves_no_file(tmp_path: Path) -> None:
    def cut(request: httpx.Request) -> httpx.Response:
        return httpx.Response(200, stream=LiveStream(b"", breaks=True))

    with client(cut) as impasto, pytest.raises(ServiceUnreachable):
        impasto.download("job_1", tmp_path / "out.mp4")
    with client(lambda r: problem(409, code="conflict", detail="Not yet.")) as impasto, pytest.raises(ImpastoError):
        impasto.download("job_1", tmp_path / "out.mp4")
    assert list(tmp_path.iterdir()) == []


def test_the_asset_id_is_computed_before_the_upload(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"abc")
    assert asset_id_of(tmp_path / "a") == f"ast_{hashlib.sha256(b'abc').hexdigest()}"
