"""`LiveClient` against a real server: frames both ways, changes, refusals, a connection that is lost."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from impasto.live.client import LiveClient
from impasto.live.wire import Answer, pack, unpack
from impasto.problems import ServiceUnreachable
from pipeline.errors import BadFrame, BadParameter, ImpastoError
from pipeline.frames import Frame
from pipeline.methods.base import Method
from service.live import frames
from service.settings import Settings
from tests.service.live import running
from tests.workers.live_toys import Echo
from workers.studio import Studio

SIZE = (96, 64)
PICTURE: Frame = np.full((64, 96, 3), (90, 120, 60), np.uint8)


@contextmanager
def served(home: Path, monkeypatch: pytest.MonkeyPatch, **more: Any) -> Iterator[str]:
    found: dict[str, Method] = {"echo": Echo()}  # type: ignore[dict-item]
    for place in ("pipeline.methods", "workers.live.live", "service.live.connection"):
        monkeypatch.setattr(f"{place}.methods", lambda: found)
    settings = Settings(home=home, pool="none", **{"live_sessions": 1, "live_resume_s": 5.0, **more})
    farm = Studio(settings, None)
    farm.start()
    with running(settings, farm) as url:
        yield url
    farm.stop()


@pytest.fixture
def url(home: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    with served(home, monkeypatch) as address:
        yield address


def echo(url: str, **more: Any) -> LiveClient:
    return LiveClient(url, **{"size": SIZE, "method": "echo", "send": ["raw"], "receive": ["raw"], **more})


def until(true: Callable[[], object], patience_s: float = 10.0) -> None:
    end = time.monotonic() + patience_s
    while not true():
        assert time.monotonic() < end
        time.sleep(0.01)


def one(client: LiveClient, frame: Frame = PICTURE) -> tuple[Answer, Frame]:
    """Send a frame and take its answer."""
    client.send(frame)
    for answer in client.answers(wait_s=5):
        return answer, client.picture(answer)
    raise AssertionError("no answer")


def test_a_header_means_the_same_at_both_ends() -> None:
    header, payload = frames.unpack(pack(b"xyz", (640, 480), True, 7, 2**40))
    assert header == frames.Header(True, 640, 480, 7, 2**40) and payload == b"xyz"
    answer = unpack(frames.pack(frames.Header(False, 320, 240, 9, 11, latency_us=1500), b"abc"))
    assert answer == Answer(9, 11, (320, 240), False, 1500, b"abc")


@pytest.mark.parametrize("message", [b"", b"\x01", b"\x02" + bytes(40)])
def test_a_frame_of_another_version_is_refused(message: bytes) -> None:
    with pytest.raises(BadFrame, match="version"):
        unpack(message)


def test_frames_come_back_painted_in_order_with_their_times(url: str) -> None:
    with echo(url, params={"add": 20}) as client:
        for number in range(1, 4):
            answer, picture = one(client)
            assert (answer.sequence, answer.size) == (number, SIZE)
            assert picture[30, 30].tolist() == [110, 140, 80]
            assert 0 < answer.latency_us < 5e6
        figures = client.close()
    assert (figures["received"], figures["painted"], figures["dropped"]) == (3, 3, 0)
    assert list(client.answers()) == []


@pytest.mark.parametrize("codec", ["jpeg", "webp", "h264", "vp8"])
def test_every_codec_brings_the_picture(url: str, codec: str) -> None:
    with echo(url, send=[codec], receive=[codec], params={"add": 20}) as client:
        pictures = [one(client)[1] for _ in range(3)]
    assert client.ready["receive"]["codec"] == codec
    for picture in pictures:
        assert np.abs(picture[20:, 20:].astype(int) - (110, 140, 80)).mean() < 6


def test_a_change_is_told_and_in_force(url: str) -> None:
    heard: list[dict[str, Any]] = []
    with echo(url, on_message=heard.append) as client:
        one(client)
        client.change({"add": 50})
        until(lambda: any(message["type"] == "params" for message in heard))
        assert one(client)[1][30, 30].tolist() == [140, 170, 110]
        client.change({"add": "much"})
        until(lambda: any(message["type"] == "error" for message in heard))
    problem = next(message["problem"] for message in heard if message["type"] == "error")
    assert problem["field"] == "params.add" or problem["field"] == "add"


def test_a_full_service_is_busy_and_says_when_to_return(url: str) -> None:
    with echo(url), pytest.raises(ImpastoError) as refused:
        echo(url).__enter__()
    assert refused.value.code == "busy" and refused.value.remedy


def test_what_is_wrong_with_hello_is_raised_as_it_is(url: str) -> None:
    with pytest.raises(BadParameter) as wrong:
        echo(url, params={"colour": "red"}).__enter__()
    assert "colour" in wrong.value.field


def test_nobody_there_is_unreachable() -> None:
    with pytest.raises(ServiceUnreachable, match="impasto serve"):
        echo("http://127.0.0.1:9").__enter__()


def test_a_lost_connection_is_taken_up_again(url: str) -> None:
    with echo(url, params={"add": 20}) as client:
        one(client)
        session = client.ready["session"]
        client._socket.socket.shutdown(2)  # type: ignore[union-attr]
        until(lambda: client.ready["resumed"])
        assert client.ready["session"] == session
        assert one(client)[1][30, 30].tolist() == [110, 140, 80]


def test_a_key_is_sent_as_over_http(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with served(home, monkeypatch, auth="required", admin_key="open sesame") as url:
        with pytest.raises(ImpastoError) as refused:
            echo(url).__enter__()
        assert refused.value.code == "unauthorized"
        with echo(url, api_key="open sesame") as client:
            one(client)
