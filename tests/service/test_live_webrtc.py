"""WHIP and WHEP with real WebRTC connections over loopback."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import av
import cv2
import httpx
import numpy as np
import pytest
from aiortc import RTCPeerConnection
from aiortc.mediastreams import MediaStreamError

from benchmarks import webrtc
from tests.service.live_client import live
from tests.service.test_live import FRAME, echo, free, hello, looped, served
from tests.service.webrtc_client import SDP, Camera, counted, offered, playing, sending

__all__ = ["echo"]

pytestmark = pytest.mark.real("webrtc")

SIZE = (96, 64)
ADD_40 = "?method=echo&prefer=sharp&params=%7B%22add%22%3A40%7D"


@pytest.fixture
def url(home: Path) -> Iterator[str]:
    with served(home) as (address, _):
        yield address


async def session_ready(url: str) -> str:
    """The id of the session once its first frame has come."""
    async with live(url, "/view") as viewer:
        return str((await viewer.message("ready", timeout_s=20))["session"])


@looped
async def test_frames_sent_by_whip_are_played_painted_by_whep(url: str) -> None:
    async with httpx.AsyncClient(base_url=url) as http:
        async with sending(http, Camera(SIZE, 20), ADD_40) as answer:
            assert answer.headers["Impasto-Session"] == await session_ready(url)
            async with playing(http) as track:
                frames: list[Any] = [await asyncio.wait_for(track.recv(), 10) for _ in range(12)]
        assert {(frame.width, frame.height) for frame in frames} == {SIZE}
        right = [float(frame.to_ndarray(format="gray")[:, 60:].mean()) for frame in frames]
        assert all(abs(value - 168) < 6 for value in right), "128 and the 40 that the method adds"
        counts = [counted(frame) for frame in frames]
        assert len(set(counts)) > 6, "frame after frame"
        assert free(url) == 2, "the session has ended with its sender"


@looped
async def test_a_websocket_session_is_played_by_whep(url: str) -> None:
    for receive in ("h264", "vp8", "jpeg"):
        async with httpx.AsyncClient(base_url=url) as http, live(url) as client:
            await hello(client, receive=[receive])

            async def feed(client: Any = client) -> None:
                while True:
                    await client.send(FRAME)
                    await client.answer()

            feeding = asyncio.create_task(feed())
            async with playing(http) as track:
                frame = await asyncio.wait_for(track.recv(), 10)
                assert isinstance(frame, av.VideoFrame) and (frame.width, frame.height) == SIZE
                feeding.cancel()
                await client.send_message({"type": "bye"})
                with pytest.raises(MediaStreamError):
                    while True:
                        await asyncio.wait_for(track.recv(), 10)


@looped
async def test_bad_webrtc_requests_are_refused(url: str) -> None:
    offer = await offered(with_video())
    async with httpx.AsyncClient(base_url=url) as http:
        for query, content, headers, status, field in (
            ("whip?method=echo", offer, {}, 415, "Content-Type"),
            ("whip?method=echo", "no sdp", SDP, 422, "body"),
            ("whip?method=echo", "x" * 70_000, SDP, 413, "body"),
            ("whip?method=cat", offer, SDP, 422, "method"),
            ("whip?method=echo&params=3", offer, SDP, 422, "params"),
            ("whip?method=echo&params=" + "[" * 3000, offer, SDP, 422, "params"),
            ("whip?method=echo&params=NaN", offer, SDP, 422, "params"),
            ("whip?method=echo", offer + section(offer) * 6, SDP, 422, "body"),
            ("whip?method=echo", offer + DATA, SDP, 422, "body"),
            ("whip?method=echo&params=%7B%22add%22%3A999%7D", offer, SDP, 422, "params.add"),
            ("whip?method=echo&prefer=fast", offer, SDP, 422, "prefer"),
            ("whip?method=echo&filter=echo", offer, SDP, 422, "filter.method"),
            ("whep", offer, SDP, 404, "session"),
        ):
            answer = await http.post(f"/v1/live/{query}", content=content, headers=headers)
            assert (answer.status_code, answer.json()["field"]) == (status, field), query
            assert answer.json()["remedy"]
        assert (await http.delete("/v1/live/peers/rtc_x")).status_code == 404
        assert (await http.patch("/v1/live/whip")).status_code == 405
    assert free(url) == 2


DATA = "m=application 9 UDP/DTLS/SCTP webrtc-datachannel\r\na=mid:9\r\na=sctp-port:5000\r\n"


def section(offer: str) -> str:
    """The offer's section of its video stream."""
    return offer[offer.index("m=video") :]


def with_video() -> RTCPeerConnection:
    peer = RTCPeerConnection()
    peer.addTransceiver("video")
    return peer


class Heard(asyncio.DatagramProtocol):
    """Counts datagrams."""

    count = 0

    def datagram_received(self, data: bytes, addr: Any) -> None:
        self.count += 1


@looped
async def test_no_packet_is_sent_to_an_address_that_an_offer_names(url: str) -> None:
    transport, heard = await asyncio.get_running_loop().create_datagram_endpoint(Heard, ("127.0.0.1", 0))
    port = transport.get_extra_info("sockname")[1]
    named = [f"a=candidate:{n} 1 udp {2130706431 - n} 127.0.0.1 {port} typ host\r\n" for n in range(300)]
    named += [f"a=candidate:{n} 1 udp 1 name-{n}.local {port} typ host\r\n" for n in range(300)]
    offer = await offered(with_video()) + "".join(named)
    async with httpx.AsyncClient(base_url=url) as http:
        answer = await http.post("/v1/live/whip?method=echo", content=offer, headers=SDP)
        assert answer.status_code == 201
        await asyncio.sleep(2)
        assert heard.count == 0
        await http.delete(answer.headers["Location"])
    transport.close()


@looped
async def test_an_offer_that_never_connects_holds_no_session(url: str) -> None:
    offer = await offered(with_video())
    async with httpx.AsyncClient(base_url=url) as http:
        found = [await http.post("/v1/live/whip?method=echo", content=offer, headers=SDP) for _ in range(6)]
        assert [answer.status_code for answer in found] == [201] * 4 + [503] * 2
        assert free(url) == 2
        async with live(url) as client:
            await hello(client)
        for answer in found[:4]:
            await http.delete(answer.headers["Location"])
        again = await http.post("/v1/live/whip?method=echo", content=offer, headers=SDP)
        assert again.status_code == 201
        await http.delete(again.headers["Location"])


@looped
async def test_all_sessions_taken_is_a_503_for_whip(url: str) -> None:
    async with httpx.AsyncClient(base_url=url) as http, live(url) as one, live(url) as other:
        await hello(one)
        await hello(other)
        answer = await http.post("/v1/live/whip?method=echo", content=await offered(with_video()), headers=SDP)
        assert (answer.status_code, answer.json()["code"]) == (503, "busy")


def test_without_aiortc_the_answer_names_the_extra(url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [name for name in sys.modules if name.startswith("service.live.webrtc.")]:
        if name != "service.live.webrtc.routes":
            monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "aiortc", None)
    answer = httpx.post(f"{url}/v1/live/whip", content="v=0", headers=SDP)
    assert (answer.status_code, answer.json()["code"]) == (501, "not-installed")
    assert "impasto[webrtc]" in answer.json()["remedy"]


def test_the_benchmark_reads_frame_numbers_and_counts_each_frame_once() -> None:
    noise = np.random.default_rng(1).integers(0, 256, (72, 128, 3), np.uint8)
    for number in (0, 5, 1365, 4095):
        shown = cv2.GaussianBlur(webrtc.numbered(noise, number), (0, 0), 1)
        assert webrtc.number_of(shown) == number
    figures = webrtc.Figures(sent={number: number / 10 for number in range(5000)})
    for number in (4990, 4990, 4992):
        figures.shown(number % 4096, number / 10 + 0.25, since=499.0)
    assert figures.seen == {4992 - 2, 4992} and figures.latencies_s == pytest.approx([0.25, 0.25])
    assert figures.row(499.0, 499.35).startswith("4 frames sent, 2 lost")
