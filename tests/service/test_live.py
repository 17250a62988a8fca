"""Live sessions over real WebSockets to a real server, following docs/live.md."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from pathlib import Path
from typing import Any

import cv2
import httpx
import numpy as np
import pytest
from websockets.exceptions import InvalidStatus

from pipeline.methods.base import Method
from pipeline.methods.steady import Steady
from pipeline.video.stills import encode_png
from service.settings import Settings
from tests.service.live import running
from tests.service.live_client import LiveClient, jpeg, live
from tests.service.toy_method import Toy
from tests.waiting import HTTP, SLOWER
from tests.workers.live_toys import Echo
from workers.farm import Farm

SIZE = (96, 64)
PICTURE = np.full((64, 96, 3), (90, 120, 60), np.uint8)
FRAME = jpeg(PICTURE)


def looped(test: Callable[..., Awaitable[None]]) -> Callable[..., None]:
    @wraps(test)
    def run(*args: Any, **named: Any) -> None:
        asyncio.run(asyncio.wait_for(test(*args, **named), 30))  # type: ignore[arg-type]

    return run


@pytest.fixture(autouse=True)
def echo(monkeypatch: pytest.MonkeyPatch) -> None:
    found: dict[str, Method] = {"echo": Echo(), "toy": Toy(), "steady": Steady()}  # type: ignore[dict-item]
    for place in ("pipeline.methods", "workers.live.sessions", "service.live.connection"):
        monkeypatch.setattr(f"{place}.methods", lambda: found)


@contextmanager
def served(home: Path, **more: Any) -> Iterator[tuple[str, Farm]]:
    settings = Settings(home=home, pool="none", **{"live_sessions": 2, "live_resume_s": 0.5, **more})
    farm = Farm(settings, None)
    farm.start()
    with running(settings, farm) as url:
        yield url, farm
    farm.stop()


@pytest.fixture
def url(home: Path) -> Iterator[str]:
    with served(home) as (address, _):
        yield address


def hello(client: LiveClient, **fields: Any) -> Awaitable[dict[str, Any]]:
    return client.hello(method="echo", **fields)


def shown(payload: bytes) -> Any:
    return cv2.imdecode(np.frombuffer(payload, np.uint8), cv2.IMREAD_COLOR_RGB)


# -- filters and sizes


@looped
async def test_a_filter_is_named_in_hello_changed_by_params_and_removed_by_null(url: str) -> None:
    async with live(url) as client:
        ready = await hello(client, filter={"method": "steady", "params": {"strength": 12}})
        assert (ready["filter"]["method"], ready["filter"]["params"]["strength"]) == ("steady", 12.0)
        assert ready["filter"]["params"]["detail"] == 1, "defaults are filled in"
        await client.send(FRAME)
        await client.answer()
        await client.send_message({"type": "params", "params": {"add": 1}})
        assert (await client.message("params"))["filter"] == ready["filter"], "not named: unchanged"
        await client.send_message({"type": "params", "filter": {"params": {"strength": 3}}})
        assert (await client.message("params"))["filter"]["params"]["strength"] == 3.0
        await client.send_message({"type": "params", "filter": {"params": {"strength": -3}}})
        assert (await client.message("error"))["problem"]["field"] == "filter.params.strength"
        await client.send_message({"type": "params", "filter": {"method": "echo"}})
        assert (await client.message("error"))["problem"]["field"] == "filter.method"
        await client.send_message({"type": "params", "filter": None})
        assert "filter" not in await client.message("params")


@looped
async def test_statistics_say_why_the_working_size_was_chosen(url: str) -> None:
    size, frame = (320, 240), jpeg(np.full((240, 320, 3), 100, np.uint8))
    async with live(url) as client:
        await hello(client, width=320, height=240, fps=20, params={"per_pixel_s": 2e-6})  # 154 ms at full size
        for _ in range(40):
            await client.send(frame, size)
            await asyncio.sleep(1 / 20)
        change = await client.message("resolution")
        assert change["reason"] == "slow"
        assert change["latency_ms"] > change["deadline_ms"] >= 50, "one period at the rate of the frames"
        chosen = (await client.message("stats"))["size"]
        assert chosen["reason"] == "slow"
        assert chosen["latency_ms"] > chosen["deadline_ms"] >= 50


# -- the way of a session


@looped
async def test_a_live_session_runs_from_hello_to_bye(url: str) -> None:
    async with live(url, subprotocols=["impasto.live.1"]) as client:
        assert client.socket.subprotocol == "impasto.live.1"
        ready = await hello(client, fps=25, params={"add": 20})
        assert ready["session"].startswith("liv_")
        assert (ready["version"], ready["resumed"], ready["deadline_ms"]) == (1, False, 40.0)
        assert ready["params"]["add"] == 20
        assert ready["params"]["analyze_s"] == 0.0
        assert (ready["send"], ready["receive"]) == ({"codec": "jpeg"}, {"codec": "jpeg"})
        for number in range(1, 4):
            await client.send(FRAME, timestamp=10**15 + number)
            answer = await client.answer()
            assert (answer.sequence, answer.timestamp, answer.size, answer.key) == (number, 10**15 + number, SIZE, True)
            assert 0 < answer.latency_us < 10**6
            assert abs(shown(answer.payload)[32, 48].astype(int) - (110, 140, 80)).max() < 8
        await client.send_message({"type": "bye"})
        stats = (await client.message("bye"))["stats"]
        assert (stats["received"], stats["painted"], stats["dropped"]) == (3, 3, 0)
        assert await client.closed() == (1000, "bye")
    assert free(url) == 2


def free(url: str, timeout_s: float = 5.0, want: int = 2) -> int:
    """Wait until this many sessions are free; the number of free sessions."""
    deadline = time.monotonic() + timeout_s
    while (found := HTTP.get(f"{url}/v1/live").json()["free"]) != want and time.monotonic() < deadline:
        time.sleep(0.02)
    return int(found)


def test_live_information_lists_methods_capacity_and_limits(url: str) -> None:
    info = httpx.get(f"{url}/v1/live").json()
    assert info["methods"] == ["echo"], "the toy is not causal"
    assert info["filters"] == ["steady"]
    assert (info["version"], info["capacity"], info["sessions"], info["free"]) == (1, 2, 0, 2)
    assert {"h264", "vp8", "jpeg", "webp", "raw"} == set(info["receives"]) == set(info["sends"])
    assert info["limits"] == {"width": 1920, "height": 1920, "fps": 120.0, "frame_bytes": 12 << 20}


@pytest.mark.parametrize(("send", "receive"), [("h264", "vp8"), ("vp8", "h264"), ("raw", "webp"), ("webp", "raw")])
def test_live_frames_are_exchanged_in_every_codec(url: str, send: str, receive: str) -> None:
    from workers.live.codecs import decoder, encoder
    from workers.live.model import WireFormat

    @looped
    async def run() -> None:
        there, back = encoder(WireFormat("jpeg", send), SIZE), decoder(receive, 1920)
        async with live(url) as client:
            ready = await hello(client, send=["cat", send], receive=[receive, "jpeg"])
            assert (ready["send"]["codec"], ready["receive"]["codec"]) == (send, receive)
            assert ready["receive"].get("webcodecs") == {"h264": "avc1.42E01F", "vp8": "vp8"}.get(receive)
            for _ in range(3):
                payload, _, key = there.encode(PICTURE, False)
                await client.send(payload, key=key)
                answer = await client.answer()
                assert np.abs(back.decode(answer.payload, SIZE)[32, 48].astype(int) - PICTURE[0, 0]).max() < 10
            await client.send_message({"type": "keyframe"})
            await asyncio.sleep(0.05)
            await client.send(there.encode(PICTURE, False)[0], key=False)
            assert (await client.answer()).key

    run()


@looped
async def test_live_statistics_are_sent_every_second(url: str) -> None:
    async with live(url) as client:
        await hello(client, params={"paint_s": 0.005})
        await client.send(FRAME)
        stats = await client.message("stats")
        assert (stats["received"], stats["painted"], stats["dropped"], stats["scale"]) == (1, 1, 0, 1.0)
        assert set(stats["stages_ms"]) == {"wait", "decode", "analyze", "paint", "encode"}
        assert stats["stages_ms"]["paint"] >= 5
        assert stats["latency_ms"]["p50"] >= 5


@looped
async def test_only_the_newest_waiting_frame_is_painted(url: str) -> None:
    async with live(url) as client:
        await hello(client, params={"paint_s": 0.05}, prefer="sharp")
        for _ in range(30):
            await client.send(FRAME)
            await asyncio.sleep(0.005)
        await client.send_message({"type": "bye"})
        stats = (await client.message("bye"))["stats"]
        assert (stats["received"], stats["received"] - stats["painted"]) == (30, stats["dropped"])
        numbers = [answer.sequence for answer in client.answers]
        assert numbers == sorted(numbers)
        assert numbers[-1] == 30
        assert 3 <= len(numbers) <= 10


@looped
async def test_overload_lowers_the_resolution_and_not_the_frame_rate(url: str) -> None:
    size = (320, 240)
    frame = jpeg(np.full((240, 320, 3), 100, np.uint8))
    async with live(url) as client:
        await hello(client, width=320, height=240, fps=40, params={"per_pixel_s": 1e-6})  # 77 ms at full size
        for _ in range(100):
            await client.send(frame, size)
            await asyncio.sleep(1 / 40)
        await client.send_message({"type": "bye"})
        await client.message("bye")
        late = [answer for answer in client.answers if answer.sequence > 60]
        assert late[-1].size[0] <= 160
        assert np.median([answer.latency_us for answer in late]) < 50_000


# -- changes


@looped
async def test_live_parameters_change_during_a_session(url: str) -> None:
    async with live(url) as client:
        await hello(client, params={"paint_s": 0.001}, receive=["raw"], send=["raw"])
        await client.send(PICTURE.tobytes())
        assert (await client.answer()).payload[:3] == bytes((0, 0, 1))
        await client.send_message({"type": "params", "params": {"add": 7}})
        answer = await client.message("params")
        assert (answer["params"]["add"], answer["params"]["paint_s"], answer["inputs"]) == (7, 0.001, {})
        await client.send(PICTURE.tobytes())
        assert (await client.answer()).payload[:3] == bytes((7, 0, 2)), "the stream went on"


@looped
async def test_an_invalid_live_change_is_ignored(url: str) -> None:
    async with live(url) as client:
        await hello(client, params={"add": 3}, receive=["raw"], send=["raw"])
        for bad, code, field in (
            ({"params": {"add": 900}}, "bad-parameter", "params.add"),
            ({"params": {"cat": 1}}, "bad-parameter", "params.cat"),
            ({"params": 3}, "bad-parameter", "params"),
            ({"inputs": {"reference": "ast_gone"}}, "not-found", "inputs.reference"),
            ({"inputs": {"video": "ast_gone"}}, "not-found", "inputs.video"),
        ):
            await client.send_message({"type": "params", **bad})
            answer = await client.message("error")
            assert not answer["fatal"]
            assert (answer["problem"]["code"], answer["problem"]["field"]) == (code, field)
            assert answer["problem"]["remedy"]
        await client.send(PICTURE.tobytes())
        assert (await client.answer()).payload[0] == 3


@looped
async def test_rapid_parameter_changes_end_with_the_last_value(url: str) -> None:
    async with live(url) as client:
        await hello(client, send=["raw"], receive=["raw"])
        for add in range(1, 41):
            await client.send_message({"type": "params", "params": {"add": add}})
        while (await client.message("params"))["params"]["add"] != 40:
            pass
        await client.send(PICTURE.tobytes())
        assert (await client.answer()).payload[0] == 40


def upload(url: str, data: bytes, name: str) -> str:
    return str(httpx.post(f"{url}/v1/assets", files={"file": (name, data)}).raise_for_status().json()["id"])


@looped
async def test_a_live_reference_is_added_and_removed(url: str) -> None:
    green, red = [
        await asyncio.to_thread(upload, url, encode_png(np.full((32, 32, 3), colour, np.uint8)), "a.png")
        for colour in ((0, 99, 0), (255, 0, 0))
    ]
    numbers = await asyncio.to_thread(upload, url, b'{"a": 1}', "a.json")
    async with live(url) as client:
        await hello(client, inputs={"reference": green}, send=["raw"], receive=["raw"])
        await client.send(PICTURE.tobytes())
        assert (await client.answer()).payload[1] == 99
        for bad in ({"reference": red}, {"reference": numbers}, {"numbers": numbers}):
            await client.send_message({"type": "params", "inputs": bad})
            assert (await client.message("error"))["problem"]["status"] == 422
        await client.send_message({"type": "params", "inputs": {"reference": None}})
        assert (await client.message("params"))["inputs"] == {}
        await client.send(PICTURE.tobytes())
        assert (await client.answer()).payload[1:3] == bytes((0, 2))


@looped
async def test_a_live_session_continues_with_another_frame_size(url: str) -> None:
    async with live(url) as client:
        await hello(client, send=["raw"], receive=["raw"])
        await client.send(PICTURE.tobytes())
        await client.answer()
        await client.send(bytes(64 * 48 * 3), (64, 48))
        answer = await client.answer()
        assert (answer.size, answer.payload[2]) == ((64, 48), 2)
        answer = next(m for m in client.messages if m["type"] == "resolution")
        assert (answer["width"], answer["height"], answer["reason"]) == (64, 48, "input")


# -- coming back


@looped
async def test_a_disconnected_client_resumes_its_session(url: str) -> None:
    async with live(url) as client:
        session = (await hello(client, params={"add": 5}, send=["raw"], receive=["raw"]))["session"]
        await client.send(PICTURE.tobytes())
        await client.answer()
        client.socket.transport.abort()
    async with live(url, f"?session={session}") as client:
        ready = await hello(client, params={"add": 6}, send=["raw"], receive=["raw"])
        assert (ready["session"], ready["resumed"], ready["params"]["add"]) == (session, True, 6)
        await client.send(PICTURE.tobytes())
        assert (await client.answer()).payload[:3] == bytes((6, 0, 2))
    async with live(url, "?session=liv_unknown") as client:
        assert not (await hello(client))["resumed"]


@looped
async def test_an_abandoned_session_expires(url: str) -> None:
    async with live(url) as client:
        session = (await hello(client))["session"]
        client.socket.transport.abort()
    assert await asyncio.to_thread(free, url, 0.2, 1) == 1, "it waits"
    assert await asyncio.to_thread(free, url) == 2
    async with live(url, f"?session={session}") as client:
        assert not (await hello(client))["resumed"]


@looped
async def test_a_second_connection_takes_over_the_session(url: str) -> None:
    async with live(url) as first:
        session = (await hello(first, params={"paint_s": 0.05}))["session"]
        await first.send(FRAME)
        async with live(url, f"?session={session}") as second:
            assert (await hello(second, params={"paint_s": 0.05}))["resumed"]
            assert await first.closed() == (4409, "taken-over")
            assert first.messages[-1]["problem"]["code"] == "taken-over"
            await second.send(FRAME)
            await second.answer()
    assert await asyncio.to_thread(free, url) == 2


@looped
async def test_a_session_closed_by_its_client_ends_at_once(url: str) -> None:
    async with live(url) as client:
        await hello(client)
    assert await asyncio.to_thread(free, url, 0.4) == 2


# -- room and keys


@looped
async def test_a_surplus_session_is_refused_at_once(url: str) -> None:
    async with live(url) as one, live(url) as two:
        await hello(one)
        await hello(two)
        began = time.monotonic()
        with pytest.raises(InvalidStatus) as answer:
            async with live(url):
                pass
        assert time.monotonic() - began < SLOWER
        answer = answer.value.response
        assert answer.status_code == 503
        assert int(answer.headers["Retry-After"]) >= 1
        assert answer.headers["Content-Type"] == "application/problem+json"
        assert b'"busy"' in (answer.body or b"")
        description = await asyncio.to_thread(httpx.get, f"{url}/v1/live")
        assert (description.json()["free"], "Retry-After" in description.headers) == (0, True)
        await one.send(FRAME)
        await one.answer()


@looped
async def test_live_sessions_require_a_key_and_a_known_protocol(home: Path) -> None:
    with served(home, auth="required", live_sessions=3) as (url, farm):  # one that has left may still be ending
        _, secret = farm.keys.create("a", ["submit"])
        _, reader = farm.keys.create("b", ["read"])
        for more, status in (
            ({}, 401),
            ({"additional_headers": {"Authorization": "Bearer nonsense"}}, 401),
            ({"additional_headers": {"Authorization": f"Bearer {reader}"}}, 403),
            ({"subprotocols": ["impasto.live.9", f"impasto.key.{secret}"]}, 400),
        ):
            with pytest.raises(InvalidStatus) as answer:
                async with live(url, **more):
                    pass
            assert answer.value.response.status_code == status
        async with live(url, additional_headers={"Authorization": f"Bearer {secret}"}) as client:
            await hello(client)
        async with live(url, subprotocols=["impasto.live.1", f"impasto.key.{secret}"]) as client:
            assert client.socket.subprotocol == "impasto.live.1"
            session = (await hello(client))["session"]
            _, other = farm.keys.create("c", ["submit"])
            headers = {"Authorization": f"Bearer {other}"}
            async with live(url, f"?session={session}", additional_headers=headers) as thief:
                assert not (await hello(thief))["resumed"]
            await client.send(FRAME)
            await client.answer()


@looped
async def test_live_connections_of_foreign_origins_are_refused(url: str) -> None:
    port = url.rsplit(":", 1)[1]
    rebound = {"host": "127.0.0.1", "port": int(port)}
    for address, more in ((url, {"origin": "http://evil.example"}), ("http://evil.example", rebound)):
        with pytest.raises(InvalidStatus) as answer:
            async with live(address, **more):
                pass
        assert answer.value.response.status_code == 403
    async with live(url, origin=f"http://127.0.0.1:{port}") as client:
        await hello(client)


def test_live_sessions_export_metrics(url: str) -> None:
    @looped
    async def run() -> None:
        async with live(url) as client:
            await hello(client)
            await client.send(FRAME)
            await client.answer()
            lines = (await asyncio.to_thread(httpx.get, f"{url}/metrics")).text.splitlines()
            assert "impasto_live_sessions 1.0" in lines

    run()
    free(url)
    lines = httpx.get(f"{url}/metrics").text.splitlines()
    for line in ("sessions 0.0", "latency_seconds_count 1.0", 'frames_total{outcome="painted"} 1.0'):
        assert f"impasto_live_{line}" in lines
