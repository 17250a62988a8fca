"""Sends frames to a worker in another process and back over a separate socket instead of Ray's actor calls.

A frame needs two calls of a Ray actor, and each costs about ten times as much latency and processor time as a message
here. A frame is one message with two answers: the first when it has been analyzed, the second with the painted frame or
the error. A connection starts with a secret that the service gave to the process; without it the connection is
closed.
"""

from __future__ import annotations

import asyncio
import contextlib
import hmac
import socket
import threading
from asyncio import Future, StreamReader, StreamWriter
from collections import deque
from queue import SimpleQueue
from typing import Any, Protocol

from pipeline.video.guard.wire import HEADER, ConnectionBroken, Message, lengths, parsed, receive
from workers.live.messages import (
    ANALYZED,
    decode_error,
    decode_frame,
    decode_request,
    encode_error,
    encode_frame,
    encode_request,
)
from workers.live.model import FrameRequest, RenderedFrame
from workers.live.worker import LiveWorkerLost

Address = tuple[str, int]

GREET_S = 2.0
"""Seconds within which a new connection must send the secret. Connections are served one at a time."""
CONNECT_S = 5.0
SECRET_BYTES = 32
_BUFFER_BYTES = 1 << 22


class FrameStages(Protocol):
    """The two stages of a frame."""

    def analyze(self, work: FrameRequest) -> None: ...
    def paint(self) -> RenderedFrame: ...


class LiveWorkerServer:
    """The worker's end of the channel: serves one connection after another, on its own threads.

    Args:
        host: this machine's address, as the service reaches it.
        secret: SECRET_BYTES bytes.
    """

    def __init__(self, painter: FrameStages, host: str, secret: bytes) -> None:
        self._painter, self._secret = painter, secret
        self._listener = socket.create_server((host, 0), family=_family(host))
        threading.Thread(target=self._serve, name="impasto-live-analyze", daemon=True).start()

    @property
    def address(self) -> Address:
        host, port = self._listener.getsockname()[:2]
        return str(host), int(port)

    def close(self) -> None:
        """Accept no more connections."""
        with contextlib.suppress(OSError):  # some systems refuse to shut down a listener; closing it is enough there
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()

    def _serve(self) -> None:
        while True:
            try:
                wire, _ = self._listener.accept()
            except OSError:
                return
            with wire:
                self._handle_connection(wire)

    def _handle_connection(self, wire: socket.socket) -> None:
        try:
            if self._handshake(wire):
                self._analyze(wire)
        except (OSError, ConnectionBroken):
            return

    def _handshake(self, wire: socket.socket) -> bool:
        wire.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        wire.settimeout(GREET_S)
        received = b""
        while len(received) < SECRET_BYTES and (more := wire.recv(SECRET_BYTES - len(received))):
            received += more
        wire.settimeout(None)
        return hmac.compare_digest(received, self._secret)

    def _analyze(self, wire: socket.socket) -> None:
        """Analyze frames as they arrive; another thread paints them."""
        tickets: SimpleQueue[bool] = SimpleQueue()
        sending = threading.Lock()
        painting = threading.Thread(target=self._paint, args=(wire, sending, tickets), name="impasto-live-paint")
        painting.start()
        try:
            while True:
                work = decode_request(*receive(wire))
                tickets.put(True)
                self._painter.analyze(work)
                _send(wire, sending, ANALYZED)
        finally:
            tickets.put(False)
            painting.join()

    def _paint(self, wire: socket.socket, sending: threading.Lock, tickets: SimpleQueue[bool]) -> None:
        while tickets.get():
            try:
                answer = encode_frame(self._painter.paint())
            except Exception as error:
                answer = encode_error(error)
            with contextlib.suppress(OSError):  # no caller waits for it any more
                _send(wire, sending, answer)


def _send(wire: socket.socket, sending: threading.Lock, data: bytes) -> None:
    with sending:
        wire.sendall(data)


def _family(host: str) -> socket.AddressFamily:
    return socket.AF_INET6 if ":" in host else socket.AF_INET


class LiveWorkerClient:
    """The service's end, made by `connect`. For one event loop only."""

    def __init__(self, reader: StreamReader, writer: StreamWriter) -> None:
        self._writer = writer
        self._analyses: deque[Future[None]] = deque()
        self._paints: deque[Future[RenderedFrame]] = deque()
        self._asked: deque[Future[RenderedFrame]] = deque()
        self._lost = False
        self._reading = asyncio.ensure_future(self._read(reader))

    @classmethod
    async def connect(cls, address: Address, secret: bytes) -> LiveWorkerClient:
        """Raises OSError, TimeoutError."""
        reader, writer = await asyncio.wait_for(asyncio.open_connection(*address, limit=_BUFFER_BYTES), CONNECT_S)
        writer.write(secret)
        return cls(reader, writer)

    def analyze(self, work: FrameRequest) -> Future[None]:
        """Send a frame. The future is done when the frame has been analyzed; it raises LiveWorkerLost if the connection
        is lost."""
        loop = asyncio.get_running_loop()
        self._analyses.append(analyzed := loop.create_future())
        self._paints.append(painted := loop.create_future())
        self._asked.append(painted)
        if self._lost:
            self._lose()
        else:
            self._writer.write(encode_request(work))
        return analyzed

    def paint(self) -> Future[RenderedFrame]:
        """Future of the painting of the oldest frame that has not been requested yet. It raises the frame's error, or
        LiveWorkerLost."""
        return self._asked.popleft()

    def close(self) -> None:
        self._reading.cancel()
        self._writer.close()
        self._lose()

    async def _read(self, reader: StreamReader) -> None:
        try:
            while True:
                text_bytes, data_bytes = lengths(await reader.readexactly(HEADER.size))
                answer = parsed(await reader.readexactly(text_bytes))
                self._answered(answer, await reader.readexactly(data_bytes))
        except (EOFError, OSError, ConnectionBroken):
            self._lose()

    def _answered(self, answer: Message, data: bytes) -> None:
        if "analyzed" in answer:
            _end(self._analyses.popleft(), None)
        elif "error" in answer:
            _end(self._paints.popleft(), decode_error(answer))
        else:
            _end(self._paints.popleft(), decode_frame(answer, data))

    def _lose(self) -> None:
        """Fail every pending call."""
        self._lost = True
        for waiting in (self._analyses, self._paints):
            while waiting:
                _end(waiting.popleft(), LiveWorkerLost("The process that painted has died."))


def _end(future: Future[Any], result: object) -> None:
    if future.done():  # the waiting task was cancelled
        return
    if isinstance(result, Exception):
        future.set_exception(result)
        future.exception()  # mark the exception as retrieved: perhaps no task waits for it
    else:
        future.set_result(result)
