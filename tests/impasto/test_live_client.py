"""`LiveClient` against the real service: frames there and back, changes, refusals, lost connections."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from impasto import LiveClient
from impasto.live.client import LiveEnded, LiveOptions, now_us
from impasto.live.wire import HEADER_BYTES, pack, unpack
from impasto_client.errors import NotAllowed, ServiceUnreachable
from pipeline.errors import BadFrame, BadParameter
from pipeline.frames import Frame
from service.live import frames as service_side
from service.live.messages import Hello
from tests.impasto.live_service import only_echo, served
from tests.waiting import until
from workers.errors import NotFound
from workers.live.worker import NoLiveWorker

SIZE = (96, 64)
PICTURE = np.full((64, 96, 3), (90, 120, 60), np.uint8)


@pytest.fixture(autouse=True)
def echo(monkeypatch: pytest.MonkeyPatch) -> None:
    only_echo(monkeypatch)


@pytest.fixture
def url(home: Path) -> Iterator[str]:
    with served(home) as (address, _):
        yield address


def client(url: str, **options: Any) -> LiveClient:
    return LiveClient(url, **{"size": SIZE, "method": "echo", "fps": 60, **options})


def one(live: LiveClient, frame: Frame = PICTURE) -> Frame:
    """Send a frame and wait for its painting."""
    sent = live.send(frame)
    for answer in live.answers(wait_s=5):
        assert answer.sequence == sent
        return live.picture(answer)
    raise AssertionError("no answer came")


# -- the wire


def test_client_and_service_messages_are_compatible() -> None:
    header, payload = service_side.unpack(pack(b"picture", (640, 360), True, 0xDEADBEEF, (1 << 63) + 5))
    assert (header.width, header.height, header.key, bytes(payload)) == (640, 360, True, b"picture")
    assert (header.sequence, header.timestamp, header.latency_us) == (0xDEADBEEF, (1 << 63) + 5, 0)
    answer = unpack(service_side.pack(service_side.Header(False, 320, 180, 7, 1 << 40, 20_500), b"painting"))
    assert (answer.size, answer.key, answer.sequence, answer.timestamp) == ((320, 180), False, 7, 1 << 40)
    assert (answer.latency_us, answer.payload) == (20_500, b"painting")


@pytest.mark.parametrize("message", [b"", b"\x01" * HEADER_BYTES, b"\x02" + b"\0" * 40])
def test_a_frame_of_another_version_is_refused(message: bytes) -> None:
    with pytest.raises(BadFrame, match="version"):
        unpack(message)


def test_the_hello_message_is_accepted_by_the_service() -> None:
    options = LiveOptions((640, 480), params={"lines": "dog"}, inputs={"reference": "ast_1"}, send=("h264", "jpeg"))
    hello = Hello.model_validate(options.hello())
    assert (hello.width, hello.height, hello.send, hello.prefer) == (640, 480, ["h264", "jpeg"], "fluent")


# -- the way of a session


@pytest.mark.parametrize("codec", ["raw", "jpeg", "webp", "h264", "vp8"])
def test_a_frame_comes_back_painted_in_every_codec(url: str, codec: str) -> None:
    with client(url, send=(codec,), receive=(codec,), quality=95, params={"add": 20}) as live:
        assert live.ready["receive"]["codec"] == codec
        for _ in range(3):  # video codecs build on the frames before
            painted = one(live)
            assert painted.shape == PICTURE.shape
            assert np.abs(painted[8:].astype(int) - (PICTURE[8:].astype(int) + 20)).mean() < 4


def test_answers_carry_send_time_and_service_time(url: str) -> None:
    with client(url) as live:
        began = now_us()
        live.send(PICTURE)
        (answer,) = live.answers(wait_s=5)
        assert began <= answer.timestamp <= now_us()
        assert 0 < answer.latency_us < now_us() - answer.timestamp
        live.send(PICTURE, timestamp=42)
        assert next(iter(live.answers(wait_s=5))).timestamp == 42


def test_close_returns_statistics_and_pending_answers(url: str) -> None:
    with client(url, params={"paint_s": 0.1}) as live:
        sent = live.send(PICTURE)
        stats = live.close()
        assert [answer.sequence for answer in live.answers()] == [sent]
        assert live.ended
    assert (stats["received"], stats["painted"]) == (1, 1)


def test_answers_are_polled_without_waiting(url: str) -> None:
    with client(url) as live:
        began = time.monotonic()
        assert list(live.answers(wait_s=0)) == []
        assert time.monotonic() - began < 0.5


def test_parameters_change_during_a_live_session(url: str) -> None:
    heard: list[dict[str, Any]] = []
    with LiveClient(url, on_message=heard.append, size=SIZE, method="echo", send=("raw",), receive=("raw",)) as live:
        assert one(live)[8, 8, 0] == 90
        live.change({"add": 50})
        until(lambda: "params" in [message["type"] for message in heard])
        assert one(live)[8, 8, 0] == 140
        live.change({"add": 9000})  # refused, and the stream goes on
        assert one(live)[8, 8, 0] == 140
    assert live.options.params == {"add": 9000}
    assert "error" in [message["type"] for message in heard]


def test_a_frame_of_another_size_changes_the_live_size(url: str) -> None:
    with client(url, send=("h264",), receive=("h264",)) as live:
        assert one(live).shape == (64, 96, 3)
        assert one(live, np.asarray(cv2.resize(PICTURE, (48, 32)), np.uint8)).shape == (32, 48, 3)


def test_an_invalid_frame_is_refused_before_sending(url: str) -> None:
    with client(url) as live, pytest.raises(BadFrame, match="uint8"):
        live.send(PICTURE.astype(np.float32))  # type: ignore[arg-type]


# -- refusals


def test_no_service_is_an_error_with_a_remedy() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
    with pytest.raises(ServiceUnreachable, match="impasto serve"), client(f"http://127.0.0.1:{port}"):
        pass


def test_a_full_service_answers_when_to_retry(home: Path) -> None:
    with served(home, live_sessions=1) as (url, _), client(url):
        began = time.monotonic()
        with pytest.raises(NoLiveWorker, match="Try again in 5 s") as caught, client(url):
            pass
    assert time.monotonic() - began < 2
    assert (caught.value.code, caught.value.retry_after_s) == ("busy", 5.0)


def test_a_missing_key_is_refused_where_one_is_required(home: Path) -> None:
    secret = "x" * 32
    with served(home, auth="required", admin_key=secret) as (url, _):
        with pytest.raises(NotAllowed), client(url):
            pass
        with client(url, api_key=secret) as live:
            assert one(live).shape == PICTURE.shape


@pytest.mark.parametrize(
    ("options", "kind", "field"),
    [
        ({"method": "nothing"}, NotFound, "method"),
        ({"params": {"add": -1}}, BadParameter, "params.add"),
        ({"inputs": {"reference": "ast_0"}}, NotFound, "inputs.reference"),
        ({"receive": ("gif",)}, BadParameter, "receive"),
        ({"size": (64, 100_000)}, BadParameter, "height"),
    ],
)
def test_a_bad_hello_raises_the_error_of_the_service(
    url: str, options: dict[str, Any], kind: type[Exception], field: str
) -> None:
    with pytest.raises(kind) as caught, client(url, **options):
        pass
    assert caught.value.field == field  # type: ignore[attr-defined]


def test_a_broken_payload_ends_the_session_with_its_reason(url: str) -> None:
    with client(url) as live:
        live.send_payload(b"not a picture", SIZE)
        with pytest.raises(BadFrame, match="jpeg"):
            list(live.answers(wait_s=5))
        with pytest.raises(BadFrame):  # a repeated call raises the same error
            list(live.answers())


# -- lost connections


class Relay:
    """A TCP relay between client and service that can be cut."""

    def __init__(self, url: str) -> None:
        self._target = ("127.0.0.1", int(url.rpartition(":")[2]))
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.url = f"http://127.0.0.1:{self._listener.getsockname()[1]}"
        self._ends: list[socket.socket] = []
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self) -> None:
        while True:
            try:
                here, _ = self._listener.accept()
            except OSError:
                return
            there = socket.create_connection(self._target)
            self._ends += [here, there]
            for one_end, other in ((here, there), (there, here)):
                threading.Thread(target=self._pump, args=(one_end, other), daemon=True).start()

    def _pump(self, source: socket.socket, sink: socket.socket) -> None:
        try:
            while data := source.recv(1 << 16):
                sink.sendall(data)
            sink.shutdown(socket.SHUT_WR)
        except OSError:
            pass  # cut

    def cut(self) -> None:
        ends, self._ends = self._ends, []
        for end in ends:
            with suppress(OSError):  # one end may have gone already
                end.shutdown(socket.SHUT_RDWR)
            end.close()

    def close(self) -> None:
        with suppress(OSError):  # closed before
            self._listener.shutdown(socket.SHUT_RDWR)  # wakes the thread that accepts
        self._listener.close()
        self.cut()


@pytest.fixture
def relay(url: str) -> Iterator[Relay]:
    relay = Relay(url)
    yield relay
    relay.close()


@pytest.mark.parametrize("codec", ["raw", "h264"])
def test_a_lost_connection_is_resumed_with_the_session_state(relay: Relay, codec: str) -> None:
    with client(relay.url, send=(codec,), receive=(codec,)) as live:
        one(live), one(live)
        session = live.ready["session"]
        relay.cut()
        until(lambda: live.ready["resumed"])
        assert (live.ready["session"], live.ready["resumed"]) == (session, True)
        painted = one(live)
        if codec == "raw":
            assert painted[0, 0, 2] == 3  # the third frame of one stream
        stats = live.close()
    assert stats["painted"] == 3


def test_frames_sent_while_disconnected_are_counted_as_lost(
    relay: Relay, monkeypatch: pytest.MonkeyPatch
) -> None:  # fmt: skip
    again = LiveClient._again
    monkeypatch.setattr(LiveClient, "_again", lambda self, *args: (time.sleep(0.5), again(self, *args))[1])
    with client(relay.url) as live:
        one(live)
        relay.cut()
        until(lambda: live.send(PICTURE) and live.unsent)
        until(lambda: live.ready["resumed"])
    assert live.unsent


def test_a_permanently_unavailable_service_ends_the_stream(relay: Relay, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("impasto.live.client.RECONNECT_S", 0.3)
    with client(relay.url) as live:
        one(live)
        relay.close()
        with pytest.raises(ServiceUnreachable):
            list(live.answers())


def test_a_repeatedly_failing_session_is_abandoned(url: str) -> None:
    with client(url, params={"fault": "paint"}) as live:
        feeding = threading.Thread(target=lambda: [(live.send(PICTURE), time.sleep(0.02)) for _ in range(150)])
        feeding.start()
        with pytest.raises(LiveEnded) as caught:
            list(live.answers(wait_s=10))
        feeding.join()
    assert caught.value.code == "internal-error"
