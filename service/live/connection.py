"""One WebSocket connection of a live session, as four concurrent tasks.

    reader     receives messages and frames; offers frames to the stream without waiting for it
    sender     sends painted frames and notices of the stream, as fast as the client reads
    changes    applies parameter changes, one after another
    statistics sends figures once a second

When one task ends, the others are cancelled and the connection ends.
"""

from __future__ import annotations

import asyncio
import time
from collections import deque
from collections.abc import Coroutine, Mapping
from dataclasses import replace

from starlette.concurrency import run_in_threadpool
from starlette.types import Message
from starlette.websockets import WebSocket

from pipeline.errors import BadFrame, BadParameter
from pipeline.frames import MIN_SIDE_PX
from pipeline.methods import methods
from service.access.keys import Principal
from service.assets.routes import visible
from service.context.depends import ServiceContext
from service.errors import BadMessage
from service.live.changes import Changes, ordered_filter, shown_filter
from service.live.closing import NORMAL, Ending, Left, Lost
from service.live.frames import HEADER_BYTES, Header, is_sound, pack, unpack
from service.live.message_sender import MessageSender
from service.live.messages import (
    FORMATS,
    ByeIn,
    ByeOut,
    Hello,
    KeyframeIn,
    KeyframeOut,
    Outgoing,
    ParamsIn,
    ReadyOut,
    ReplacedOut,
    Resolution,
    Sending,
    Stats,
    parse,
    receiving,
)
from service.live.sessions import LiveSession, Sessions
from service.live.viewers import ViewedFrame, ViewFormat
from workers.contract.record import Asset
from workers.errors import NotFound
from workers.live.codecs import BUILT_ON
from workers.live.model import LiveOrder, Packet, WireFormat
from workers.live.resolution import deadline_s
from workers.live.stream import Answer, Item, KeyframeNeeded, Replaced, Resized, Stream

MAX_FRAMES_PER_S = 240
MAX_SOUND_PER_S = 240


class Connection:
    """
    Args:
        socket: accepted.
        parts: shared parts of the service.
        sessions: keeps the session when this connection is lost.
    """

    def __init__(self, socket: WebSocket, context: ServiceContext, sessions: Sessions, principal: Principal) -> None:
        self._socket, self._context, self._sessions, self._principal = socket, context, sessions, principal
        self._settings = context.settings
        self._stopped: asyncio.Future[Ending] = asyncio.get_running_loop().create_future()
        self._over, self._closed = asyncio.Event(), asyncio.Event()
        self._sender = MessageSender(socket, context.settings.live_slow_s)
        self._changes = Changes(sessions.live, self._sender, self._assets)
        self._arrivals: deque[float] = deque(maxlen=MAX_FRAMES_PER_S)
        self._sounds: deque[float] = deque(maxlen=MAX_SOUND_PER_S)
        self._sequence = -1

    async def stop(self, ending: Ending) -> None:
        if not self._stopped.done():
            self._stopped.set_result(ending)
        await self._over.wait()

    async def wait_closed(self) -> None:
        await self._closed.wait()

    def abandon(self, session: LiveSession) -> None:
        """The client disconnected before the WebSocket was accepted."""
        self._release(session, keep=True)
        self._closed.set()

    async def run(self, session: LiveSession) -> None:
        """Serve until the connection ends; then close it, and keep or end the session."""
        try:
            await self._race(self._serve(session), self._wait_for_stop())
        except (Lost, Left) as left:
            self._release(session, keep=isinstance(left, Lost))
        except Exception as error:
            self._release(session, keep=isinstance(error, Ending) and error.code == "taken-over")
            await self._sender.fail(error)
        else:
            self._release(session, keep=False)
            await self._sender.close(NORMAL, "bye")
        finally:
            self._release(session, keep=False)
            self._closed.set()

    def _release(self, session: LiveSession, keep: bool) -> None:
        if self._over.is_set():
            return
        self._over.set()
        if keep:
            self._sessions.leave(session, self)
        elif session.connection is self:
            self._sessions.end(session)

    async def _wait_for_stop(self) -> None:
        raise await asyncio.shield(self._stopped)

    async def _serve(self, session: LiveSession) -> None:
        hello = await self._receive_hello()
        await self._race(self._begin(session, hello), self._refuse_messages())
        stream = session.stream
        assert stream is not None, "it has begun"
        await self._race(self._exchange(session, stream), self._send(session, stream))
        self._sessions.count(session)
        await self._sender.send_message(ByeOut(stats=Stats(**stream.figures())))

    async def _exchange(self, session: LiveSession, stream: Stream) -> None:
        """Exchange frames until the client sends bye and has received its last frame."""
        await self._race(
            self._read(session, stream), self._changes.run(session, stream), self._send_statistics(session, stream)
        )
        await self._race(stream.finish(), self._discard_messages())

    @staticmethod
    async def _race(*works: Coroutine[object, None, None]) -> None:
        """Run until the first is done, cancel the others, and raise the error of the first."""
        tasks = [asyncio.create_task(work) for work in works]
        try:
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
        for task in done:
            task.result()

    # -- opening

    async def _receive_hello(self) -> Hello:
        try:
            async with asyncio.timeout(self._settings.live_hello_s):
                message = await self._receive()
        except TimeoutError:
            raise Ending(
                "hello-timeout", f"No hello within {self._settings.live_hello_s:g} s.", remedy="Send it first."
            ) from None
        parsed = parse(message) if isinstance(message, str) else None
        if not isinstance(parsed, Hello):
            raise BadMessage("The first message must be hello.", field="type", remedy="Send hello, then frames.")
        return parsed

    async def _begin(self, session: LiveSession, hello: Hello) -> None:
        """Open the session's stream, or resume it, and send `ready`."""
        order = await self._order(hello)
        session.inputs = dict(hello.inputs)
        before = session.stream
        resumed = before is not None and (before.order.method, before.order.seed) == (order.method, order.seed)
        if before is not None and resumed:
            await before.attach(order.wire, order.size, hello.prefer == "fluent")
            wanted = replace(before.order, params=order.params, inputs=order.inputs, filter=order.filter)
            if wanted != before.order:
                await before.change(wanted)
        else:
            await self._open(session, order, hello.prefer == "fluent")
        session.viewers.announce(ViewFormat(order.wire.receive, order.size, hello.fps))
        await self._sender.send_message(self._ready(session, hello, order, resumed))

    async def _order(self, hello: Hello) -> LiveOrder:
        """Raises NotFound, BadParameter."""
        live = self._sessions.live
        if hello.method not in methods():
            remedy = f"Use one of: {', '.join(live.methods())}."
            raise NotFound(f"Unknown method {hello.method!r}.", field="method", value=hello.method, remedy=remedy)
        send = _chosen("send", hello.send, live.receives)
        wire = WireFormat(send, _chosen("receive", hello.receive, live.sends), hello.quality, hello.fps)
        assets = await self._assets(hello.inputs)
        order = live.order(hello.method, hello.params, assets, hello.seed, (hello.width, hello.height), wire)
        return replace(order, filter=ordered_filter(live, hello.filter))

    async def _open(self, session: LiveSession, order: LiveOrder, adaptive: bool) -> None:
        if session.stream is not None:
            before, session.stream = session.stream, None
            await before.aclose()
        stream = self._sessions.live.stream(order, adaptive)
        await stream.open()
        session.stream, session.counted = stream, (0, 0, 0)

    async def _assets(self, inputs: Mapping[str, str]) -> dict[str, Asset]:
        def found() -> dict[str, Asset]:
            return {
                name: visible(self._context, self._principal, asset_id, f"inputs.{name}")
                for name, asset_id in inputs.items()
            }

        return await run_in_threadpool(found)

    @staticmethod
    def _ready(session: LiveSession, hello: Hello, order: LiveOrder, resumed: bool) -> ReadyOut:
        send = order.wire.send
        return ReadyOut(
            session=session.id, resumed=resumed, method=order.method, params=dict(order.params),
            filter=shown_filter(order.filter), prefer=hello.prefer,
            send=Sending(codec=send, format=FORMATS.get(send)),
            receive=receiving(order.wire.receive, (hello.width, hello.height), hello.fps),
            width=hello.width, height=hello.height, fps=hello.fps,
            deadline_ms=round(1000 * deadline_s(1 / hello.fps), 1),
        )  # fmt: skip

    # -- reading

    async def _receive(self) -> str | bytes:
        message = await self._socket.receive()
        if message["type"] == "websocket.disconnect":
            raise Lost if _is_lost(message) else Left
        data: str | bytes | None = message.get("bytes")
        if data is None:
            data = str(message.get("text", ""))
        most = self._sessions.live.limits.frame_bytes + HEADER_BYTES
        most = most if isinstance(data, bytes) else self._settings.max_json_bytes
        if len(data) > most:
            raise Ending(
                "too-large", "The message is too large.", field="message", value=f"{len(data)} bytes",
                remedy=f"At most {most} bytes.",
            )  # fmt: skip
        return data

    async def _read(self, session: LiveSession, stream: Stream) -> None:
        """Receive until the client sends bye."""
        deadline = asyncio.get_running_loop().time() + self._settings.live_idle_s
        while True:
            try:
                async with asyncio.timeout_at(deadline):
                    message = await self._receive()
            except TimeoutError:
                raise Ending(
                    "idle", f"No frame for {self._settings.live_idle_s:g} s.", remedy="Connect again."
                ) from None
            if isinstance(message, bytes) and is_sound(message):
                _check_rate(self._sounds, "packets of sound", time.perf_counter())
                session.viewers.hear(message)
            elif isinstance(message, bytes):
                stream.offer(self._packet(message, stream))
                deadline = asyncio.get_running_loop().time() + self._settings.live_idle_s
            elif await self._handle_control(message, stream):
                return

    def _packet(self, message: bytes, stream: Stream) -> Packet:
        now = time.perf_counter()
        _check_rate(self._arrivals, "frames", now)
        header, payload = unpack(message)
        if header.sequence <= self._sequence:
            raise BadMessage(
                "Sequence numbers must increase.", field="frame.sequence", value=header.sequence,
                remedy=f"The one before was {self._sequence}.",
            )  # fmt: skip
        self._sequence = header.sequence
        self._check_size(header)
        key = header.key or stream.order.wire.send not in BUILT_ON
        return Packet(header.sequence, header.timestamp, (header.width, header.height), key, payload, now)

    def _check_size(self, header: Header) -> None:
        most, value = self._sessions.live.limits.side_px, f"{header.width}x{header.height}"
        if max(header.width, header.height) > most:
            raise Ending(
                "too-large",
                "The picture is too large.",
                field="frame",
                value=value,
                remedy=f"At most {most} px a side.",
            )
        if min(header.width, header.height) < MIN_SIDE_PX:
            raise BadFrame(
                "The picture is too small.", field="frame", value=value, remedy=f"At least {MIN_SIDE_PX} px a side."
            )

    async def _handle_control(self, text: str, stream: Stream) -> bool:
        """Handle a JSON message of a running session. Returns True for bye."""
        try:
            parsed = parse(text)
        except BadParameter as error:
            await self._sender.send_error(error)
            return False
        if isinstance(parsed, Hello):
            raise BadMessage(
                "hello may be sent only once.", field="type", value="hello", remedy="Send params to change them."
            )
        if isinstance(parsed, KeyframeIn):
            stream.want_key()
        elif isinstance(parsed, ParamsIn):
            self._changes.ask(parsed)
        return isinstance(parsed, ByeIn)

    async def _refuse_messages(self) -> None:
        """Check that the client waits for `ready`. Raises BadMessage at any message; Lost, Left."""
        await self._receive()
        raise BadMessage(
            "No message is accepted before ready.", field="message", remedy="Wait for ready, then send frames."
        )

    async def _discard_messages(self) -> None:
        """After bye: discard messages until the client leaves."""
        while True:
            await self._receive()

    # -- sending

    async def _send(self, session: LiveSession, stream: Stream) -> None:
        while (item := await stream.next()) is not None:
            if isinstance(item, Answer):
                await self._answer(item, session, stream)
            else:
                await self._sender.send_message(self._notice(item))

    async def _answer(self, answer: Answer, session: LiveSession, stream: Stream) -> None:
        packet, painted = answer.packet, answer.painted
        latency_s = time.perf_counter() - packet.at_s
        header = Header(painted.key, *painted.size, packet.sequence, packet.timestamp, round(latency_s * 1e6))
        session.viewers.show(ViewedFrame(header, painted.data), stream)
        await self._sender.send_frame(pack(header, painted.data))
        latency_s = time.perf_counter() - packet.at_s
        stream.sent(answer, latency_s)
        self._sessions.metrics.latency.observe(latency_s)

    def _notice(self, item: Item) -> Outgoing:
        if isinstance(item, Resized):
            return _resolution(item)
        if isinstance(item, Replaced):
            self._sessions.metrics.lost.inc()
            return ReplacedOut(reason=item.reason)
        assert isinstance(item, KeyframeNeeded)
        return KeyframeOut(reason=item.reason)

    async def _send_statistics(self, session: LiveSession, stream: Stream) -> None:
        while True:
            await asyncio.sleep(1.0)
            self._sessions.count(session)
            await self._sender.send_message(Stats(**stream.second()))


def _resolution(item: Resized) -> Resolution:
    why, measured = item.why, item.why.deadline_s > 0
    return Resolution(
        width=item.size[0], height=item.size[1], scale=item.scale, reason=why.reason,
        latency_ms=round(1000 * why.latency_s, 1) if measured else None,
        deadline_ms=round(1000 * why.deadline_s, 1) if measured else None,
    )  # fmt: skip


def _check_rate(arrivals: deque[float], what: str, now: float) -> None:
    """Note an arrival. Raises Ending if as many as `arrivals` holds came within the last second."""
    if len(arrivals) == arrivals.maxlen and now - arrivals[0] < 1.0:
        raise Ending("rate-limited", f"More than {arrivals.maxlen} {what} in a second.", remedy="Send fewer.")
    arrivals.append(now)


def _is_lost(disconnect: Message) -> bool:
    """Whether the connection broke: then there is no close frame, and therefore no reason, not even an empty one."""
    return disconnect.get("code") in (1005, 1006) and "reason" not in disconnect


def _chosen(field: str, asked: list[str], there: tuple[str, ...]) -> str:
    """The first of the client's codecs that the service supports."""
    for codec in asked:
        if codec in there:
            return codec
    raise BadParameter(
        f"None of these codecs is known: {field}.", field=field, value=", ".join(asked),
        remedy=f"Use some of: {', '.join(there)}.",
    )  # fmt: skip
