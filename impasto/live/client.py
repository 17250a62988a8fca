"""`LiveClient`: send frames to a service and receive the stylised frames.

    with LiveClient("http://127.0.0.1:8420", size=(640, 480), fps=30) as live:
        for frame in frames:
            live.send(frame)
            for answer in live.answers(wait_s=0):
                show(live.picture(answer))
        live.close()
        for answer in live.answers():  # those that were still on their way
            show(live.picture(answer))

Frames are sent on the caller's thread; answers are received on a thread of the client. A lost connection is resumed.
Frames that are sent meanwhile are dropped, just as the service drops frames that it cannot paint in time.
"""

from __future__ import annotations

import json
import queue
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import TracebackType
from typing import Any, Self

import httpx
from websockets.exceptions import ConnectionClosed, InvalidStatus, WebSocketException
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from impasto.live.wire import SUBPROTOCOL, Answer, pack, unpack
from impasto_client import DEFAULT_SERVER
from impasto_client.errors import BY_CODE, ServiceUnreachable
from impasto_client.network import is_loopback, remedy_for
from impasto_client.problems import error_of
from pipeline.errors import ImpastoError
from pipeline.frames import Frame, check_frame
from pipeline.method_names import DEFAULT
from workers.contract.request import Json
from workers.live.codecs import Decoder, Encoder, decoder, encoder
from workers.live.model import WireFormat
from workers.live.worker import NoLiveWorker

MAX_MESSAGE_BYTES = 128 << 20
MAX_SIDE_PX = 16384
ANSWERS_KEPT = 120
"""Maximum number of answers that wait for the caller. Beyond it, reading stops, and the service drops frames."""
RECONNECT_S = 10.0
"""Time for which a lost connection is retried, seconds: equal to the time for which the service keeps the session."""
CLOSE_S = 2.0
FRUITLESS = 3
"""Maximum number of consecutive connections that break without an answer."""
_RETRIED = frozenset({1001, 1006, 1011, 1012})
"""Close codes after which connecting again may help."""


class LiveEnded(ImpastoError):
    """The service has ended the session; `code` is the close reason."""

    code = "live-ended"


@dataclass(frozen=True)
class LiveOptions:
    """Fields of the message `hello`: see docs/live.md."""

    size: tuple[int, int]
    fps: float = 30.0
    method: str = DEFAULT
    params: Mapping[str, object] = field(default_factory=dict)
    inputs: Mapping[str, str] = field(default_factory=dict)
    """Input name -> asset id."""
    seed: int = 0
    send: Sequence[str] = ("jpeg",)
    receive: Sequence[str] = ("jpeg",)
    quality: int = 85
    prefer: str = "fluent"
    """"fluent": keep the rate; "sharp": keep the working size."""
    filter: Mapping[str, object] | None = None
    """{"method": "steady", "params": {...}}: a filter of the painted frames."""

    def hello(self) -> Json:
        return {
            "type": "hello", "method": self.method, "params": dict(self.params), "inputs": dict(self.inputs),
            "seed": self.seed, "width": self.size[0], "height": self.size[1], "fps": self.fps, "send": [*self.send],
            "receive": [*self.receive], "quality": self.quality, "prefer": self.prefer,
            "filter": dict(self.filter) if self.filter else None,
        }  # fmt: skip


class LiveClient:
    """One live session. A context manager. `send` and `answers` may be called from two threads.

    Args:
        server: address without `/v1`.
        api_key: empty where the service is open (loopback).
        on_message: called with each JSON message of the service, on the client's thread.
        timeout_s: seconds to connect, and for the answer to `hello` (a reference may have to be learned).
        options: fields of `LiveOptions`: `size` at least.

    Raises: ServiceUnreachable, NotAllowed, NoLiveWorker (busy: try again after its `retry_after_s`), and any other
    error with which the service refuses.
    """

    def __init__(
        self, server: str = DEFAULT_SERVER, api_key: str = "", on_message: Callable[[Json], None] = lambda _: None,
        timeout_s: float = 60.0, **options: Any,
    ) -> None:  # fmt: skip
        self.options = LiveOptions(**options)
        self.ready: Json = {}
        """The service's answer to `hello`."""
        self.stats: Json = {}
        """The newest statistics; after `close`, those of the whole session."""
        self.unsent = 0
        """Number of frames not sent for lack of a connection."""
        self.ended = False
        """Whether `answers` has reached the end of the session."""
        self._server, self._key, self._timeout_s = server.rstrip("/"), api_key, timeout_s
        self._tell = on_message
        self._answers: queue.Queue[Answer | ImpastoError | None] = queue.Queue(ANSWERS_KEPT)
        self._socket: ClientConnection | None = None
        self._encoder: tuple[tuple[int, int], Encoder] | None = None
        self._decoder: Decoder | None = None
        self._sequence, self._want_key = 0, True
        self._sending = threading.Lock()
        """Held while a frame is encoded and sent: a video codec's state belongs to one connection."""
        self._fruitless = 0
        self._leaving, self._over = False, threading.Event()
        self._reader = threading.Thread(target=self._read, name="impasto-live", daemon=True)

    # -- life

    def __enter__(self) -> Self:
        self._connect()
        self._reader.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close(patience_s=5.0 if kind is None else 1.0)

    def close(self, patience_s: float = 5.0) -> Json:
        """End the session and return its statistics. Remaining answers are kept."""
        self._leaving = True
        if self._socket is not None and not self._over.is_set():
            self._send_message({"type": "bye"})
            self._over.wait(patience_s)
            self._socket.close()
        return self.stats

    def _connect(self) -> None:
        query = f"?session={self.ready['session']}" if self.ready else ""
        address = "ws" + self._server.removeprefix("http") + "/v1/live" + query
        headers = {"Authorization": f"Bearer {self._key}"} if self._key else {}
        try:
            socket = connect(
                address, subprotocols=[Subprotocol(SUBPROTOCOL)], additional_headers=headers, compression=None,
                max_size=MAX_MESSAGE_BYTES, open_timeout=min(10.0, self._timeout_s), close_timeout=CLOSE_S,
                max_queue=8, proxy=None if is_loopback(self._server) else True,
            ).__enter__()  # fmt: skip
        except InvalidStatus as refused:
            raise _refusal(refused) from None
        except (OSError, WebSocketException, TimeoutError) as error:
            raise ServiceUnreachable(
                f"No answer: {error or type(error).__name__}.", field="server", value=self._server,
                remedy=remedy_for(error),
            ) from error  # fmt: skip
        self._handshake(socket)

    def _handshake(self, socket: ClientConnection) -> None:
        try:
            socket.send(json.dumps(self.options.hello()))
            answer = json.loads(socket.recv(timeout=self._timeout_s))
            if answer["type"] == "error":
                raise _problem(answer)
        except (ConnectionClosed, TimeoutError, ImpastoError) as error:
            socket.close()
            raise error if isinstance(error, ImpastoError) else _ended(socket) from error
        with self._sending:
            self.ready, self._socket = answer, socket
            self._encoder, self._want_key = None, True
        self._decoder = decoder(answer["receive"]["codec"], MAX_SIDE_PX)
        self._tell(answer)

    # -- frames

    @property
    def next_sequence(self) -> int:
        """Sequence number of the next frame."""
        return self._sequence + 1

    def send(self, frame: Frame, timestamp: int | None = None) -> int:
        """Encode a frame (uint8 (h, w, 3) RGB) as agreed and send it; its sequence number.

        `timestamp` comes back with the answer; None: microseconds of `time.monotonic`. Raises BadFrame.
        """
        frame, stamp = check_frame(frame), now_us() if timestamp is None else timestamp
        with self._sending:
            payload, size, key = self._encoded(frame)
            return self._send(payload, size, key, stamp)

    def send_payload(
        self, payload: bytes, size: tuple[int, int], key: bool = True, timestamp: int | None = None
    ) -> int:
        """Send an encoded frame."""
        with self._sending:
            return self._send(payload, size, key, now_us() if timestamp is None else timestamp)

    def _encoded(self, frame: Frame) -> tuple[bytes, tuple[int, int], bool]:
        size = (frame.shape[1], frame.shape[0])
        if self._encoder is None or self._encoder[0] != size:
            codec = str(self.ready["send"]["codec"])
            self._encoder = (size, encoder(_wire(codec, self.options), size))
        want_key, self._want_key = self._want_key, False
        payload, _coded, key = self._encoder[1].encode(frame, want_key)
        return payload, size, key

    def _send(self, payload: bytes, size: tuple[int, int], key: bool, stamp: int) -> int:
        self._sequence += 1
        try:
            assert self._socket is not None, "frames are sent within `with`"
            self._socket.send(pack(payload, size, key, self._sequence, stamp))
        except ConnectionClosed:
            self.unsent += 1
        return self._sequence

    def answers(self, wait_s: float | None = None) -> Iterator[Answer]:
        """Answers as they come, to the end of the session; with `wait_s`, those that are there or come within it.

        Raises: LiveEnded, or the error with which the service ended the session.
        """
        while True:
            try:
                item = self._answers.get(timeout=wait_s) if wait_s != 0 else self._answers.get_nowait()
            except queue.Empty:
                return
            if item is None or isinstance(item, ImpastoError):
                self.ended = True
                self._answers.put(item)  # for later calls
                if item is None:
                    return
                raise item
            yield item
            wait_s = 0 if wait_s is not None else None

    def picture(self, answer: Answer) -> Frame:
        """The frame of an answer, uint8 (h, w, 3) RGB. With a video codec: every answer, in order."""
        assert self._decoder is not None
        return self._decoder.decode(answer.payload, answer.size)

    # -- messages

    def change(
        self, params: Mapping[str, object] | None = None, inputs: Mapping[str, str | None] | None = None
    ) -> None:
        """Change parameters or references from the next frame on; the service answers to `on_message`."""
        self.options = replace(
            self.options, params={**self.options.params, **(params or {})},
            inputs={k: v for k, v in {**self.options.inputs, **(inputs or {})}.items() if v is not None},
        )  # fmt: skip
        self._send_message({"type": "params", "params": dict(params or {}), "inputs": dict(inputs or {})})

    def _send_message(self, message: Json) -> None:
        try:
            if self._socket is not None:
                self._socket.send(json.dumps(message))
        except ConnectionClosed:
            return  # the reader has noticed the loss; the next hello contains the present values

    # -- the client's thread

    def _read(self) -> None:
        end: ImpastoError | None = None
        try:
            while True:
                assert self._socket is not None
                if self._take(self._socket):
                    break
                self._again()
        except ImpastoError as error:
            end = error
        finally:
            self._over.set()
            self._answers.put(end)

    def _take(self, socket: ClientConnection) -> bool:
        """Receive until the connection ends. Returns True at the end of the session, False after a loss."""
        fatal: ImpastoError | None = None
        try:
            for message in socket:
                if isinstance(message, bytes):
                    self._answers.put(unpack(message))
                    self._fruitless = 0
                else:
                    fatal = self._handle_message(json.loads(message)) or fatal
        except ConnectionClosed:
            pass  # the close code tells the reason
        if self._leaving or socket.close_code == 1000:
            return True
        self._fruitless += 1
        if socket.close_code in _RETRIED and self._fruitless < FRUITLESS:
            return False
        raise fatal or _ended(socket)

    def _handle_message(self, message: Json) -> ImpastoError | None:
        if message["type"] in ("stats", "bye"):
            self.stats = message.get("stats", message)
            if message["type"] == "bye":
                self._over.set()
        elif message["type"] == "keyframe":
            self._want_key = True
        self._tell(message)
        return _problem(message) if message["type"] == "error" and message.get("fatal") else None

    def _again(self) -> None:
        """Reconnect and resume the session. Raises the last error once the time-out has passed."""
        deadline, wait_s = time.monotonic() + RECONNECT_S, 0.1
        while True:
            try:
                return self._connect()
            except ImpastoError as error:
                permanent = not isinstance(error, ServiceUnreachable | NoLiveWorker)
                if permanent or self._leaving or time.monotonic() + wait_s > deadline:
                    raise
            time.sleep(wait_s)
            wait_s = min(2 * wait_s, 1.0)


def now_us() -> int:
    """Microseconds of this process's monotonic clock, the default time stamp of `LiveClient.send`."""
    return time.monotonic_ns() // 1000


def _wire(codec: str, options: LiveOptions) -> WireFormat:
    """Settings of the encoder of sent frames."""
    return WireFormat(send=codec, receive=codec, quality=options.quality, fps=options.fps)


def _problem(message: Json) -> ImpastoError:
    problem = message["problem"]
    if problem.get("code") == NoLiveWorker.code:
        return _busy(problem.get("detail"), message.get("retry_after_s"))
    kind = BY_CODE.get(problem.get("code", ""), LiveEnded)
    error = kind(
        problem.get("detail") or "The service ended the session.", field=problem.get("field") or "",
        value=problem.get("value"), remedy=problem.get("remedy") or "",
    )  # fmt: skip
    error.code = problem.get("code") or error.code
    return error


def _refusal(refused: InvalidStatus) -> ImpastoError:
    """The error with which the service refused the WebSocket."""
    response = refused.response
    error = error_of(httpx.Response(response.status_code, content=bytes(response.body or b"")))
    if error.code == NoLiveWorker.code:
        return _busy(error.message, response.headers.get("Retry-After"))
    return error


def _busy(message: str | None, retry_after_s: str | float | None) -> NoLiveWorker:
    wait_s = float(retry_after_s or 5.0)
    remedy = f"Try again in {wait_s:g} s, end another session, or raise IMPASTO_LIVE_SESSIONS."
    return NoLiveWorker(message or "The service is busy.", retry_after_s=wait_s, field="server", remedy=remedy)


def _ended(socket: ClientConnection) -> LiveEnded:
    code, reason = socket.close_code, socket.close_reason or "no reason"
    return LiveEnded(
        f"The service ended the session ({code}, {reason}).",
        field="live",
        value=code,
        remedy="See docs/live.md, Closing.",
    )
