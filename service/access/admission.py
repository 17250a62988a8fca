"""Admission of requests by the class of their cost, so that no route and no owner can take all threads.

Every synchronous route belongs to a class: `Cost.QUERY`, unless `costs` declares another one beside the route. A
request waits, without a thread, until its class has a free slot for its owner; owners take turns. One whose client has
left does not begin. Only as many threads as the classes have slots are taken by routes together; the program's own
threads (keys, files, webhooks) are additional.
"""

from __future__ import annotations

import inspect
from collections.abc import AsyncIterator, Awaitable, Callable, Coroutine, Iterator, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, TypeVar

import anyio
from anyio.to_thread import current_default_thread_limiter
from fastapi.dependencies.models import Dependant
from fastapi.routing import APIRoute
from pydantic import BaseModel
from starlette.requests import Request
from starlette.responses import Response

from pipeline.errors import BadParameter, did_you_mean
from service.access.keys import EVERYONE, Principal
from service.errors import Busy, retry_after
from service.settings import Settings
from workers.process.fair_slots import FairSlots

OWN_THREADS = 40
"""Threads beside those of routes."""
FRAME_WAIT_S = 3.0
"""Maximum wait of a request for a frame slot, seconds; then it is answered with 503."""
PREVIEW_WAIT_S = 1.0
READINGS, READING_WAIT_S = 8, 600.0
BODY_WAIT_S = 10.0
WAIT_S = 20.0
"""Maximum wait of any other request, seconds."""
_LOOK_S = 0.25
"""Interval at which a waiting request looks whether its client has left, seconds."""
Route = TypeVar("Route", bound=Callable[..., Any])
Gone = Callable[[], Awaitable[bool]]
"""Function: whether the client has left."""


async def _stays() -> bool:
    return False


class Cost(StrEnum):
    """Classes of the cost of a request."""

    HEALTH = "health"
    """State of the service, for probes and monitors."""
    BODY = "body"
    """A large body, which is held from its reading until the answer begins. Not a class of routes."""
    QUERY = "query"
    """A bounded number of bounded queries: milliseconds."""
    HEAVY = "heavy"
    """Work in proportion to a document, an archive or many jobs: up to seconds."""
    FRAMES = "frames"
    """Decodes or paints one picture."""
    PREVIEWS = "previews"
    """Stylises one frame."""
    READING = "reading"
    """Reads or writes a whole upload or archive: up to minutes."""


@dataclass(frozen=True)
class Class:
    """Limits of a class of cost."""

    at_once: int
    by_owner: int
    """Requests of one owner at once; no limit for the only user of a service without keys."""
    wait_s: float
    busy: str = "Too many requests are in progress."


def classes(settings: Settings) -> dict[Cost, Class]:
    frames, previews = settings.frame_slots, settings.preview_slots
    return {
        Cost.HEALTH: Class(4, 2, WAIT_S),
        Cost.BODY: Class(4, 2, BODY_WAIT_S, "Too many large requests are being answered."),
        Cost.QUERY: Class(16, 4, WAIT_S),
        Cost.HEAVY: Class(4, 2, WAIT_S),
        Cost.FRAMES: Class(frames, max(1, frames - 1), FRAME_WAIT_S, "Too many frames are being decoded."),
        Cost.PREVIEWS: Class(previews, max(1, previews - 1), PREVIEW_WAIT_S, "Previews are busy."),
        Cost.READING: Class(READINGS, READINGS // 2, READING_WAIT_S, "Too many files are being read."),
    }


class Admission:
    """The slots of every class. Used on the event loop only."""

    def __init__(self, known: Mapping[Cost, Class]) -> None:
        self._classes = known
        self._shared = {cost: FairSlots(each.at_once, each.by_owner) for cost, each in known.items()}
        self._alone = {cost: FairSlots(each.at_once) for cost, each in known.items()}

    def start(self) -> None:
        """Let the event loop have enough threads for all slots."""
        most = sum(each.at_once for each in self._classes.values())
        current_default_thread_limiter().total_tokens = OWN_THREADS + most

    def held(self, cost: Cost) -> int:
        """Number of slots that are taken."""
        return self._shared[cost].held + self._alone[cost].held

    @asynccontextmanager
    async def one(
        self, cost: Cost, principal: Principal | None, address: str = "@", gone: Gone = _stays
    ) -> AsyncIterator[None]:
        """Hold a slot while the block runs. Raises Busy if there is none in time, or if the client has left.

        Args:
            principal: the caller; None: known by `address` only.
        """
        slots = (self._alone if principal is EVERYONE else self._shared)[cost]
        turn = anyio.Event()
        ticket = slots.enter(address if principal is None else principal.owner, turn.set)
        try:
            with anyio.move_on_after(self._classes[cost].wait_s):
                await _wait(turn, gone)
            if not ticket.granted or await gone():
                raise Busy(self._classes[cost].busy, headers=retry_after(1), remedy="Ask again in a second.")
            yield
        finally:
            slots.leave(ticket)


async def _wait(turn: anyio.Event, gone: Gone) -> None:
    """Wait for the turn, or until the client has left."""
    while not turn.is_set() and not await gone():
        with anyio.move_on_after(_LOOK_S):
            await turn.wait()


def costs(cost: Cost) -> Callable[[Route], Route]:
    """Declare the class of a route. Write it below the decorator of the route."""

    def declare(route: Route) -> Route:
        route.cost = cost  # type: ignore[attr-defined]
        return route

    return declare


def cost_of(endpoint: Callable[..., Any]) -> Cost | None:
    """The class of a route; None: an asynchronous route without one, which takes no thread while it waits."""
    default = None if inspect.iscoroutinefunction(endpoint) else Cost.QUERY
    return getattr(endpoint, "cost", default)


class AdmittedRoute(APIRoute):
    """A route whose requests are admitted by their cost. Those of the API refuse unknown query parameters."""

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        handle, cost, known = super().get_route_handler(), cost_of(self.endpoint), frozenset(_queries(self.dependant))
        is_api = self.include_in_schema and self.path.startswith("/v1/")  # pages read queries in the browser

        async def admitted(request: Request) -> Response:
            for name in request.query_params.keys() - known if is_api else ():
                raise BadParameter(f"Unknown query parameter {name!r}.", field=name, value=request.query_params[name],
                                   remedy=did_you_mean(name, sorted(known), "parameters"))  # fmt: skip
            if cost is None:
                return await handle(request)
            await request.body()  # read and bounded before; a message that follows it says that the client has left
            admission: Admission = request.app.state.service.admission
            address = f"@{request.client.host}" if request.client else "@"
            async with admission.one(cost, request.state.principal, address, request.is_disconnected):
                return await handle(request)

        return admitted


def _queries(dependant: Dependant) -> Iterator[str]:
    """The names of the query parameters of a route, those of models among them."""
    for field in dependant.query_params:
        kind = field.field_info.annotation
        if inspect.isclass(kind) and issubclass(kind, BaseModel):
            yield from kind.model_fields
        else:
            yield field.alias
    for inner in dependant.dependencies:
        yield from _queries(inner)
