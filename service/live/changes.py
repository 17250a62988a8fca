"""Changes of parameters and references while a session runs, one after another."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass, replace

from pipeline.errors import BadInput
from service.live.closing import Ending
from service.live.message_sender import MessageSender
from service.live.messages import FilterIn, FilterOut, ParamsIn, ParamsOut
from service.live.sessions import LiveSession
from workers.contract.record import Asset
from workers.contract.request import Json
from workers.errors import NotFound
from workers.live.model import FilterOrder
from workers.live.sessions import LiveSessions
from workers.live.stream import Stream

MAX_WAITING = 64

Find = Callable[[Mapping[str, str]], Awaitable[dict[str, Asset]]]
"""Assets by input name, as the caller may see them. Raises NotFound."""


@dataclass(frozen=True)
class _RequestedChange:
    """Parameters and references to apply."""

    params: Json
    inputs: dict[str, str]
    """Asset ids."""
    keys: Mapping[str, str]
    """Blob keys."""
    filter: FilterOrder | None


class Changes:
    """
    Args:
        find: looks up assets that the caller may see.
    """

    def __init__(self, live: LiveSessions, sender: MessageSender, find: Find) -> None:
        self._live, self._sender, self._find = live, sender, find
        self._asked: asyncio.Queue[ParamsIn] = asyncio.Queue(MAX_WAITING)

    def ask(self, change: ParamsIn) -> None:
        """Queue a change. Raises Ending if too many are waiting."""
        try:
            self._asked.put_nowait(change)
        except asyncio.QueueFull:
            raise Ending("rate-limited", "Too many changes wait.", remedy="Send fewer.") from None

    async def run(self, session: LiveSession, stream: Stream) -> None:
        """Apply changes until cancelled. Those that arrive together (a moving slider) count as one."""
        while True:
            asked = [await self._asked.get()]
            while not self._asked.empty():
                asked.append(self._asked.get_nowait())
            await self._make(asked, session, stream)

    async def _make(self, asked: list[ParamsIn], session: LiveSession, stream: Stream) -> None:
        order = stream.order
        before = wanted = _RequestedChange(dict(order.params), dict(session.inputs), order.inputs, order.filter)
        try:
            for change in asked:
                wanted = await self._with(change, wanted, order.method)
            if wanted is not before:
                await stream.change(replace(order, params=wanted.params, inputs=wanted.keys, filter=wanted.filter))
        except (BadInput, NotFound) as error:
            await self._sender.send_error(error)
            return
        if wanted is not before:
            session.inputs = wanted.inputs
            shown = shown_filter(wanted.filter)
            await self._sender.send_message(ParamsOut(params=wanted.params, inputs=wanted.inputs, filter=shown))

    async def _with(self, change: ParamsIn, now: _RequestedChange, method: str) -> _RequestedChange:
        """`now` with the change; `now` itself if the change is invalid, which is reported to the client."""
        try:
            params = self._live.params(method, {**now.params, **change.params})
            inputs = {n: asset for n, asset in {**now.inputs, **change.inputs}.items() if asset is not None}
            keys = self._live.inputs(method, await self._find(inputs)) if change.inputs else now.keys
            behind = ordered_filter(self._live, change.filter) if "filter" in change.model_fields_set else now.filter
        except (BadInput, NotFound) as error:
            await self._sender.send_error(error)
            return now
        return _RequestedChange(params, inputs, keys, behind)


def ordered_filter(live: LiveSessions, wanted: FilterIn | None) -> FilterOrder | None:
    """A checked filter. Raises BadParameter."""
    return live.filter(wanted.method, wanted.params) if wanted else None


def shown_filter(order: FilterOrder | None) -> FilterOut | None:
    return FilterOut(method=order.method, params=dict(order.params)) if order else None
