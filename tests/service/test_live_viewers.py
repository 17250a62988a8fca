"""Viewers of a live session receive its painted frames and do not disturb other connections."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from pathlib import Path

import pytest
from websockets.exceptions import InvalidStatus

from service.live.connection import MAX_SOUND_PER_S
from service.live.frames import Header
from service.live.viewers import MAX_WAITING, MAX_WAITING_SOUND, ViewedFrame, ViewedSound, Viewers, ViewFormat
from tests.service.live_client import HEADER, live
from tests.service.test_live import FRAME, SIZE, echo, hello, looped, served
from workers.live.model import LiveOrder, WireFormat
from workers.live.stream import Stream

__all__ = ["echo"]

VIDEO, IMAGES = ViewFormat("h264", SIZE, 30.0), ViewFormat("jpeg", SIZE, 30.0)


@pytest.fixture
def url(home: Path) -> Iterator[str]:
    with served(home) as (address, _):
        yield address


@looped
async def test_a_viewer_receives_the_frames_of_the_session(url: str) -> None:
    async with live(url) as client, live(url, "/view") as viewer:
        assert (await viewer.message("waiting"))["type"] == "waiting"
        ready = await hello(client, fps=25)
        shown = await viewer.message("ready")
        assert (shown["session"], shown["receive"], shown["fps"]) == (ready["session"], ready["receive"], 25.0)
        for _ in range(3):
            await client.send(FRAME, timestamp=7)
            assert await viewer.answer() == await client.answer()
        await client.send_message({"type": "bye"})
        await client.closed()
        await viewer.message("waiting")


@looped
async def test_a_viewer_of_one_session_is_closed_at_its_end(url: str) -> None:
    async with live(url) as client:
        session = (await hello(client))["session"]
        async with live(url, f"/view?session={session}") as viewer:
            await viewer.message("ready")
            await client.send_message({"type": "bye"})
            await client.closed()
            assert await viewer.closed() == (1000, "bye")
    with pytest.raises(InvalidStatus) as refused:
        async with live(url, f"/view?session={session}"):
            pass
    assert refused.value.response.status_code == 404


@looped
async def test_a_late_viewer_of_a_video_codec_starts_with_a_key_frame(url: str) -> None:
    async with live(url) as client:
        await hello(client, receive=["h264"])
        for _ in range(3):
            await client.send(FRAME)
            await client.answer()
        async with live(url, "/view") as viewer:
            assert (await viewer.message("ready"))["receive"]["codec"] == "h264"
            for _ in range(3):
                await client.send(FRAME)
                await client.answer()
            assert (await viewer.answer()).key
            await viewer.send_message({"type": "keyframe"})
            await asyncio.sleep(0.1)
            await client.send(FRAME)
            await client.send(FRAME)
            await client.answer()
            while not (await viewer.answer()).key:
                pass


def sound(number: int, channels: int = 2, payload: bytes = b"opus", flags: int = 2) -> bytes:
    return HEADER.pack(1, flags, channels, 0, 0, number, 0, 1000 * number, 0) + payload


@looped
async def test_viewers_that_want_sound_get_it_unchanged_and_others_do_not(url: str) -> None:
    async with live(url) as client, live(url, "/view?sound=true") as hearing, live(url, "/view") as deaf:
        await hello(client)
        await hearing.message("ready")
        await deaf.message("ready")
        for number in (1, 2):
            await client.socket.send(sound(number))
        await client.send(FRAME)
        answers = [await hearing.answer() for _ in range(3)]
        assert [(one.payload, one.timestamp) for one in answers if one.payload == b"opus"] == [
            (b"opus", 1000), (b"opus", 2000)
        ]  # fmt: skip
        assert (await deaf.answer()).payload != b"opus"


@looped
@pytest.mark.parametrize(
    "message",
    [sound(1, channels=3), sound(1, payload=bytes(4001)), sound(1, flags=3)],
    ids=["three channels", "too long", "a key frame, too"],
)
async def test_sound_of_a_wrong_form_ends_the_connection(url: str, message: bytes) -> None:
    async with live(url) as client:
        await hello(client)
        await client.socket.send(message)
        assert (await client.closed())[0] == 4400


@looped
async def test_too_much_sound_is_refused(url: str) -> None:
    async with live(url) as client:
        await hello(client)
        for number in range(MAX_SOUND_PER_S + 1):
            await client.socket.send(sound(number))
        assert (await client.closed())[0] == 4429


@looped
async def test_a_slow_viewer_keeps_two_seconds_of_sound_and_its_frames() -> None:
    viewers = Viewers()
    viewers.announce(VIDEO)
    with viewers.watch(sound=True) as viewer:
        viewers.show(frame(0, key=True), Keyed())
        for number in range(MAX_WAITING_SOUND + 5):
            viewers.hear(sound(number))
        viewers.end()
        items = []
        while (item := await viewer.next()) is not None:
            items.append(item)
    kept = [item.message for item in items if isinstance(item, ViewedSound)]
    assert kept == [sound(number) for number in range(5, MAX_WAITING_SOUND + 5)]
    assert sum(isinstance(item, ViewedFrame) for item in items) == 1


@looped
async def test_a_viewer_may_send_nothing_but_requests_for_key_frames(url: str) -> None:
    async with live(url, "/view") as viewer:
        await viewer.send_message({"type": "bye"})
        assert (await viewer.closed())[0] == 4400


@looped
async def test_a_viewer_sees_sessions_of_its_own_owner_only(home: Path) -> None:
    with served(home, auth="required", admin_key="operator-key") as (url, farm):
        secrets = [farm.keys.create(name, ["read", "submit"])[1] for name in ("anna", "ben")]
        anna, ben, operator = ({"Authorization": f"Bearer {key}"} for key in (*secrets, "operator-key"))
        async with live(url, additional_headers=anna) as client:
            session = (await hello(client))["session"]
            query = f"/view?session={session}"
            for headers in (anna, operator):
                async with live(url, query, additional_headers=headers) as viewer:
                    assert (await viewer.message("ready"))["session"] == session
            with pytest.raises(InvalidStatus) as refused:
                async with live(url, query, additional_headers=ben):
                    pass
            assert refused.value.response.status_code == 404
            async with live(url, "/view", additional_headers=ben) as viewer:
                await viewer.message("waiting")


# -- slow viewers


class Keyed(Stream):
    """Counts requests for key frames."""

    def __init__(self) -> None:
        super().__init__(None, LiveOrder("echo", {}, 0, {}, SIZE, WireFormat("jpeg", "h264")))  # type: ignore[arg-type]
        self.wanted = 0

    def want_key(self) -> None:
        self.wanted += 1


def frame(number: int, key: bool = False) -> ViewedFrame:
    return ViewedFrame(Header(key, *SIZE, number, 0), b"x")


async def drained(viewers: Viewers, frames: list[ViewedFrame], form: ViewFormat) -> tuple[list[int], int]:
    """Sequence numbers received by a viewer that reads only after all frames, and its requests for key frames."""
    stream, got = Keyed(), []
    viewers.announce(form)
    with viewers.watch() as viewer:
        for each in frames:
            viewers.show(each, stream)
        viewers.end()
        while (item := await viewer.next()) is not None:
            got += [item.header.sequence] if isinstance(item, ViewedFrame) else []
    return got, stream.wanted


@looped
async def test_a_slow_viewer_of_images_gets_the_newest() -> None:
    got, _ = await drained(Viewers(), [frame(n, key=True) for n in range(9)], IMAGES)
    assert got == [8]


@looped
async def test_a_slow_viewer_of_video_continues_at_a_key_frame() -> None:
    frames = [frame(n, key=n in (0, MAX_WAITING + 5)) for n in range(MAX_WAITING + 8)]
    got, wanted = await drained(Viewers(), frames, VIDEO)
    assert got == [MAX_WAITING + 5, MAX_WAITING + 6, MAX_WAITING + 7]
    assert wanted >= 2, "at the start, and when frames were left out"
