"""Bad uploads and requests on a real farm: each gives a 4xx problem with code, field and remedy."""

from __future__ import annotations

import io
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pytest
from fastapi.testclient import TestClient

from service.app import create_app
from service.errors import TABLE, Problem
from service.settings import Settings
from tests.service.conftest import open_client
from workers.farm import open_farm


@dataclass
class Server:
    """A client of a real farm that accepts jobs and runs nothing, and an asset on it."""

    client: TestClient
    asset: str
    clip: bytes

    def upload(self, data: bytes, name: str = "clip.mp4") -> Any:
        return self.client.post("/v1/assets", files={"file": (name, data)})

    def submit(self, **more: Any) -> Any:
        body = {"method": "abstraction", "inputs": {"video": self.asset}} | more
        return self.client.post("/v1/jobs", json=body)

    def raw(self, text: str, **headers: str) -> Any:
        return self.client.post("/v1/jobs", content=text, headers={"Content-Type": "application/json"} | headers)


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory, tiny_clip: Path) -> Iterator[Server]:
    home = tmp_path_factory.mktemp("home")
    settings = Settings(home=home, pool="none", max_json_bytes=4096, max_asset_bytes=1 << 20, quota_active_jobs=3)
    farm = open_farm(settings)
    farm.start()
    for client in open_client(settings, farm):
        found = Server(client, "", tiny_clip.read_bytes())
        found.asset = found.upload(found.clip).json()["id"]
        yield found
    farm.stop()


# -- bytes


def png(width: int, height: int) -> bytes:
    return cv2.imencode(".png", np.full((height, width, 3), 127, np.uint8))[1].tobytes()


def png_header(width: int, height: int) -> bytes:
    """A PNG with one row of data whose header declares a far larger size: a small decompression bomb."""

    def part(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + part(b"IHDR", head) + part(b"IDAT", zlib.compress(b"\0" * 100)) + part(b"IEND", b"")


def archive(name: str, data: bytes = b"x") -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr(name, data)
    return out.getvalue()


def sound_only() -> bytes:
    out = io.BytesIO()
    with av.open(out, "w", format="mp4") as file:
        stream = file.add_stream("aac", rate=44100, layout="mono")
        for index in range(4):
            frame = av.AudioFrame.from_ndarray(np.zeros((1, 1024), np.int16), format="s16", layout="mono")
            frame.sample_rate, frame.pts = 44100, index * 1024
            file.mux(stream.encode(frame))
        file.mux(stream.encode(None))
    return out.getvalue()


def unknown_codec(clip: bytes) -> bytes:
    assert b"avc1" in clip
    return clip.replace(b"avc1", b"zzzz").replace(b"avcC", b"zzzC")


def nested(levels: int) -> str:
    return '{"method": "abstraction", "inputs": {}, "params": {"lines": ' + "[" * levels + "]" * levels + "}}"


def frames_named(*names: str) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as file:
        for name in names:
            file.writestr(name, png(32, 32))
    return out.getvalue()


def half_lost(clip: Path) -> bytes:
    """An H.264 stream without timestamps, so that frames are counted; its second half cannot be decoded."""
    with av.open(str(clip)) as source, av.open(out := io.BytesIO(), "w", format="h264") as sink:
        stream = sink.add_stream_from_template(source.streams.video[0])
        for packet in source.demux(video=0):
            if packet.dts is not None:
                packet.stream = stream
                sink.mux(packet)
    data = out.getvalue()
    units = data.split(b"\0\0\0\1")
    broken = [
        unit if index < len(units) // 2 else unit[:1] + b"\xff" * len(unit[1:]) for index, unit in enumerate(units)
    ]
    return b"\0\0\0\1".join(broken)


# -- the table: name -> (what is sent, status, code, field)

Case = tuple[Callable[[Server], Any], int, str, str]

UPLOADS: dict[str, Case] = {
    "no bytes": (lambda b: b.upload(b""), 422, "unreadable-media", "file"),
    "a truncated clip": (lambda b: b.upload(b.clip[: len(b.clip) // 2]), 422, "unreadable-media", "file"),
    "only the first bytes": (lambda b: b.upload(b.clip[:40]), 422, "unreadable-media", "file"),
    "a renamed program": (lambda b: b.upload(b"\x7fELF" + bytes(500)), 422, "unreadable-media", "file"),
    "a renamed text": (lambda b: b.upload(b"hello " * 50), 422, "unreadable-media", "file"),
    "an unknown codec": (lambda b: b.upload(unknown_codec(b.clip)), 422, "unreadable-media", "file"),
    "sound only": (lambda b: b.upload(sound_only()), 422, "no-video-stream", "file"),
    "one pixel": (lambda b: b.upload(png(1, 1), "p.png"), 422, "", ""),
    "20000x20000 in the header": (lambda b: b.upload(png_header(20000, 20000), "p.png"), 413, "media-too-large", ""),
    "a zip that climbs out": (lambda b: b.upload(archive("../../evil.png", png(32, 32)), "z.zip"), 422, "", ""),
    "a zip of nothing useful": (lambda b: b.upload(archive("a.txt"), "z.zip"), 422, "", ""),
    "a zip with a very long number": (
        lambda b: b.upload(frames_named("0.png", "9" * 5000 + ".png"), "z.zip"),
        422,
        "unreadable-media",
        "file",
    ),
    "a zip bomb": (lambda b: b.upload(archive("0.png", bytes(300 << 20)), "z.zip"), 413, "media-too-large", "file"),
    "too many bytes": (lambda b: b.upload(bytes(2 << 20)), 413, "body-too-large", "body"),
    "a path for a name": (lambda b: b.upload(b.clip, "../../etc/passwd"), 422, "bad-parameter", "filename"),
    "a path for a Windows name": (lambda b: b.upload(b.clip, "..\\evil.mp4"), 422, "bad-parameter", "filename"),
    "an endless name": (lambda b: b.upload(b.clip, "x" * 300), 422, "bad-parameter", "filename"),
    "another field": (
        lambda b: b.client.post("/v1/assets", files={"movie": ("a.mp4", b.clip)}),
        400,
        "bad-request",
        "movie",
    ),
    "two files": (
        lambda b: b.client.post("/v1/assets", files=[("file", ("a.mp4", b.clip)), ("file", ("b.mp4", b.clip))]),
        400,
        "bad-request",
        "file",
    ),
    "no form": (
        lambda b: b.client.post("/v1/assets", content=b.clip, headers={"Content-Type": "video/mp4"}),
        415,
        "unsupported-media-type",
        "Content-Type",
    ),
    "a form that ends early": (
        lambda b: b.client.post(
            "/v1/assets",
            content=b'--x\r\nContent-Disposition: form-data; name="file"; filename="a.mp4"\r\n\r\nabc',
            headers={"Content-Type": "multipart/form-data; boundary=x"},
        ),
        400,
        "bad-request",
        "body",
    ),
    "a form without a boundary": (
        lambda b: b.client.post("/v1/assets", content=b"x", headers={"Content-Type": "multipart/form-data"}),
        400,
        "bad-request",
        "body",
    ),
}

REQUESTS: dict[str, Case] = {
    "no JSON": (lambda b: b.raw("{"), 400, "bad-json", "body"),
    "NaN": (lambda b: b.raw('{"method": NaN}'), 400, "bad-json", "body"),
    "Infinity": (lambda b: b.raw('{"params": {"x": -Infinity}}'), 400, "bad-json", "body"),
    "a number beyond numbers": (lambda b: b.raw('{"params": {"x": 1e999}}'), 400, "bad-json", "body"),
    "half a character": (lambda b: b.raw('{"name": "\\ud800"}'), 400, "bad-json", "body"),
    "a NUL": (lambda b: b.raw('{"name": "\\u0000"}'), 400, "bad-json", "body"),
    "deep parameters": (lambda b: b.raw(nested(480)), 400, "bad-json", "body"),
    "deeper parameters": (lambda b: b.raw(nested(950)), 400, "bad-json", "body"),
    "endless nesting": (lambda b: b.raw("[" * 4000), 400, "bad-json", "body"),
    "too much JSON": (lambda b: b.raw('"' + "x" * 5000 + '"'), 413, "body-too-large", "body"),
    "JSON as a form": (lambda b: b.raw("{}", **{"Content-Type": "text/plain"}), 415, "unsupported-media-type", ""),
    "a list": (lambda b: b.raw("[]"), 422, "bad-parameter", "body"),
    "no method": (lambda b: b.raw('{"inputs": {}}'), 422, "bad-parameter", "method"),
    "an unknown method": (lambda b: b.submit(method="oil"), 422, "bad-parameter", "method"),
    "an unknown field": (lambda b: b.submit(colour="red"), 422, "bad-parameter", "colour"),
    "an unknown parameter": (lambda b: b.submit(params={"nope": 1}), 422, "bad-parameter", "params.nope"),
    "a parameter of the wrong type": (lambda b: b.submit(params={"lines": "x"}), 422, "bad-parameter", "params.lines"),
    "an input that is not there": (
        lambda b: b.submit(inputs={"video": "ast_" + "0" * 64}),
        404,
        "not-found",
        "inputs.video",
    ),
    "no video": (lambda b: b.submit(inputs={}), 422, "bad-parameter", "inputs.video"),
    "an unknown input": (lambda b: b.submit(inputs={"video": b.asset, "x": b.asset}), 422, "bad-parameter", "inputs.x"),
    "a negative seed": (lambda b: b.submit(seed=-1), 422, "bad-parameter", "seed"),
    "a seed beyond whole numbers": (lambda b: b.submit(seed=2**70), 422, "bad-parameter", "seed"),
    "priority": (lambda b: b.submit(priority=101), 422, "bad-parameter", "priority"),
    "format": (lambda b: b.submit(output={"format": "avi"}), 422, "bad-parameter", "output.format"),
    "quality": (lambda b: b.submit(output={"quality": 99}), 422, "bad-parameter", "output.quality"),
    "an unknown artefact": (lambda b: b.submit(output={"artefacts": ["x"]}), 422, "bad-parameter", ""),
    "a webhook that is no URL": (lambda b: b.submit(webhook="nowhere"), 422, "bad-parameter", "webhook"),
    "a webhook into this machine": (
        lambda b: b.submit(webhook="http://127.0.0.1:1/"),
        422,
        "bad-parameter",
        "webhook",
    ),
    "a webhook by file": (lambda b: b.submit(webhook="file:///etc/passwd"), 422, "bad-parameter", "webhook"),
    "a limit": (lambda b: b.client.get("/v1/jobs?limit=0"), 422, "bad-parameter", "limit"),
    "a cursor": (lambda b: b.client.get("/v1/jobs?cursor=%00x"), 422, "bad-parameter", "cursor"),
    "a cursor of assets": (lambda b: b.client.get("/v1/assets?cursor=bm8="), 422, "bad-parameter", "cursor"),
    "a state": (lambda b: b.client.get("/v1/jobs?state=done"), 422, "bad-parameter", "state"),
    "a label": (lambda b: b.client.get("/v1/jobs?label=shot"), 422, "bad-parameter", "label"),
    "no such job": (lambda b: b.client.get("/v1/jobs/job_none"), 404, "not-found", "job_id"),
    "no such task": (lambda b: b.client.get("/v1/tasks/tsk_none/log"), 404, "not-found", "task_id"),
    "no such address": (lambda b: b.client.get("/v1/nowhere"), 404, "not-found", "path"),
    "another verb": (lambda b: b.client.put("/v1/jobs"), 405, "method-not-allowed", "method"),
    "an idempotency key": (
        lambda b: b.raw('{"method": "abstraction", "inputs": {}}', **{"Idempotency-Key": "a b"}),
        422,
        "bad-parameter",
        "idempotency-key",
    ),
    "a preview of no frame": (
        lambda b: b.client.post(
            "/v1/previews", json={"method": "abstraction", "inputs": {"video": b.asset}, "frame": -1}
        ),
        422,
        "bad-parameter",
        "frame",
    ),
}


@pytest.mark.parametrize("name", [*UPLOADS, *REQUESTS])
def test_bad_requests_are_refused_with_code_field_and_remedy(server: Server, name: str) -> None:
    send, status, code, field = (UPLOADS | REQUESTS)[name]
    answer = send(server)
    assert answer.status_code == status, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    problem = Problem.model_validate(answer.json())
    assert problem.status == status == TABLE[problem.code][0]
    assert problem.code == (code or problem.code)
    assert problem.field == field or (not field and problem.field)
    assert problem.remedy.endswith((".", "?"))
    assert problem.detail
    assert problem.type == f"urn:impasto:problem:{problem.code}"


def test_all_errors_of_a_request_are_reported_together(server: Server) -> None:
    answer = server.submit(params={"line": "off", "growing_limit": 1e9}, output={"artefacts": ["labls"]})
    errors = {fault["field"]: fault["remedy"] for fault in answer.json()["errors"]}
    assert set(errors) == {"params.line", "params.growing_limit", "output.artefacts"}
    assert "Did you mean 'lines'?" in errors["params.line"]
    shape = server.submit(seed=-1, priority=101, colour="red").json()["errors"]
    assert {fault["field"] for fault in shape} == {"seed", "priority", "colour"}


def test_a_url_as_input_is_refused(server: Server) -> None:
    answer = server.submit(inputs={"video": "https://example.org/a.mp4"})
    assert (answer.status_code, answer.json()["field"]) == (422, "inputs.video")
    assert "URL" in answer.json()["detail"]


def test_errors_do_not_echo_large_values(server: Server) -> None:
    private = {"lines": {f"secret-{index}": index for index in range(30)}}
    assert "secret" not in server.submit(params=private).text


def test_superscript_digits_in_a_zip_are_letters(server: Server) -> None:
    answer = server.upload(frames_named("²1.png", "²2.png"), "z.zip")
    assert (answer.status_code, answer.json()["info"]["frames"]) == (201, 2)
    server.client.delete(f"/v1/assets/{answer.json()['id']}")


def test_pictures_that_do_not_decode_are_no_frames_of_a_stream_without_times(server: Server, tiny_clip: Path) -> None:
    sent = server.upload(half_lost(tiny_clip), "clip.h264")
    assert sent.status_code == 201, sent.text
    asset = sent.json()["id"]
    frames = sent.json()["info"]["frames"]
    whole = server.client.get(f"/v1/assets/{server.asset}").json()["info"]["frames"]
    assert 0 < frames < whole
    request = {"method": "abstraction", "inputs": {"video": asset}, "frame": frames - 1, "max_side_px": 64}
    for answer in (
        server.client.get(f"/v1/assets/{asset}/frame?index={frames - 1}"),
        server.client.post("/v1/previews", json=request),
    ):
        assert answer.status_code == 200, answer.text
    server.client.delete(f"/v1/assets/{asset}")


def test_refused_requests_store_nothing(server: Server) -> None:
    assert [row["id"] for row in server.client.get("/v1/assets").json()["items"]] == [server.asset]
    assert server.client.get("/v1/jobs").json()["items"] == []


def test_a_reused_idempotency_key_and_an_exceeded_job_quota_are_refused(server: Server) -> None:
    def submit(seed: int, key: str) -> Any:
        body = {"method": "abstraction", "inputs": {"video": server.asset}, "seed": seed}
        return server.client.post("/v1/jobs", json=body, headers={"Idempotency-Key": key})

    first, again, other = submit(1, "k"), submit(1, "k"), submit(2, "k")
    assert (first.status_code, again.status_code) == (201, 200)
    assert first.json()["id"] == again.json()["id"]
    assert (other.status_code, other.json()["code"]) == (422, "idempotency-mismatch")
    assert other.json()["remedy"]
    assert submit(3, "l").status_code == submit(4, "m").status_code == 201
    full = submit(5, "n")
    assert (full.status_code, full.json()["code"], full.json()["field"]) == (429, "quota-exceeded", "active_jobs")


def test_an_internal_error_reveals_no_details(settings: Settings, caplog: pytest.LogCaptureFixture) -> None:
    farm = open_farm(settings.model_copy(update={"pool": "none"}))
    app = create_app(settings, farm)
    app.add_api_route("/v1/broken", lambda: 1 / 0)
    with TestClient(app, "http://localhost", raise_server_exceptions=False) as client:
        answer = client.get("/v1/broken")
    farm.stop()
    assert (answer.status_code, answer.json()["code"]) == (500, "internal-error")
    assert "division" not in answer.text
    assert "ZeroDivisionError" in caplog.text


@pytest.mark.parametrize("path", ["/v1/jobs?stat=failed", "/v1/methods?nope=1", "/v1/assets?mising=hold"])
def test_a_query_parameter_that_a_route_does_not_have_is_refused(server: Server, path: str) -> None:
    answer = server.client.get(path)
    assert (answer.status_code, answer.json()["code"]) == (422, "bad-parameter")
    assert answer.json()["field"] == path.partition("?")[2].partition("=")[0]
    if "stat" in path:
        assert "Did you mean 'state'?" in answer.json()["remedy"]
