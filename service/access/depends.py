"""Dependencies of routes: the caller, with the scope that the route needs, and the service's context."""

from __future__ import annotations

import threading
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass, field
from typing import Annotated, cast

from anyio import CapacityLimiter, Semaphore, move_on_after
from fastapi import Depends, Request, Security
from fastapi.security import HTTPAuthorizationCredentials, HTTPBearer
from prometheus_client import CollectorRegistry

from service.access.keys import Principal, Scope
from service.errors import Busy, Forbidden, retry_after
from service.ops.load_history import LoadHistory
from service.settings import Settings
from service.styles.library import StyleLibrary
from service.webhooks.secrets import WebhookSecrets
from workers.farm import Farm

FRAME_WAIT_S = 3.0
"""Maximum wait of a request for a frame slot, seconds; then it is answered with 503."""
READINGS = 8
"""Number of uploads and archives that are read or written at once."""
DOWNLOADS = 16
"""Number of downloaded chunks that are read from the blob store at once."""


class Streams:
    """Counts open event streams. They wait in separate threads, so that they cannot block other requests."""

    def __init__(self, most: int) -> None:
        self._most, self._open = most, 0
        self.threads = CapacityLimiter(most)

    @property
    def full(self) -> bool:
        return self._open >= self._most

    def count(self) -> int:
        """Number of open streams."""
        return self._open

    @contextmanager
    def one(self) -> Iterator[None]:
        """Count a stream while the block runs. Call it on the event loop only."""
        self._open += 1
        try:
            yield
        finally:
            self._open -= 1


class FrameSlots:
    """Slots of requests that decode frames. A request that waits for a slot occupies no thread."""

    def __init__(self, most: int) -> None:
        self._free = Semaphore(most)

    @asynccontextmanager
    async def one(self) -> AsyncIterator[None]:
        """Hold a slot while the block runs. Raises Busy if none is free within `FRAME_WAIT_S`."""
        with move_on_after(FRAME_WAIT_S) as waiting:
            await self._free.acquire()
        if waiting.cancelled_caught:
            raise Busy("Too many frames are being decoded.", headers=retry_after(1), remedy="Ask again in a second.")
        try:
            yield
        finally:
            self._free.release()


@dataclass
class ServiceContext:
    """Shared objects of all routes: settings, farm, semaphores, metrics. Created by `create_app`."""

    settings: Settings
    farm: Farm
    streams: Streams
    previews: threading.BoundedSemaphore
    """Slots for previews of one frame."""
    preview_threads: CapacityLimiter
    """Threads in which previews of projects are made, so that they cannot block other requests."""
    frames: FrameSlots
    """Slots for decoding single frames of assets and films, and pictures of styles."""
    webhook_secrets: WebhookSecrets
    styles: StyleLibrary
    registry: CollectorRegistry
    """Registry of this app's metrics."""
    reading_threads: CapacityLimiter = field(default_factory=lambda: CapacityLimiter(READINGS))
    """Threads in which finished uploads and archives are read. Each may take minutes and must not block other
    requests."""
    download_threads: CapacityLimiter = field(default_factory=lambda: CapacityLimiter(DOWNLOADS))
    """Threads in which downloads are read: a blob store that answers slowly must not block other requests."""
    load: LoadHistory = field(default_factory=LoadHistory)
    """Load of this machine over the last hour."""
    closing: threading.Event = field(default_factory=threading.Event)
    """Set when the process is about to stop: event streams end."""


async def _context(request: Request) -> ServiceContext:  # async: no thread is needed, nothing blocks
    return cast(ServiceContext, request.app.state.service)


async def _frame_slot(context: Annotated[ServiceContext, Depends(_context)]) -> AsyncIterator[None]:
    async with context.frames.one():
        yield


bearer = HTTPBearer(auto_error=False, description="An API key. On loopback none is needed by default.")


def _requires(*scopes: Scope) -> Callable[..., Awaitable[Principal]]:
    async def caller(
        request: Request, _documented: Annotated[HTTPAuthorizationCredentials | None, Security(bearer)] = None
    ) -> Principal:
        principal = cast(Principal, request.state.principal)
        for scope in scopes:
            if not principal.may(scope):
                raise Forbidden(
                    f"This key lacks the scope {scope.value!r}.",
                    field="Authorization",
                    value=", ".join(sorted(principal.scopes)),
                    remedy=f"Use a key with the scope {scope.value!r}.",
                )
        return principal

    return caller


Context = Annotated[ServiceContext, Depends(_context)]
Reader = Annotated[Principal, Depends(_requires(Scope.READ))]
Submitter = Annotated[Principal, Depends(_requires(Scope.SUBMIT))]
Sharer = Annotated[Principal, Depends(_requires(Scope.SUBMIT, Scope.READ))]
"""A caller who lets others read: nobody gives away more than they have."""
Admin = Annotated[Principal, Depends(_requires(Scope.ADMIN))]
NEEDS_FRAME_SLOT = Depends(_frame_slot, scope="function")
"""Dependency of a route that decodes frames: at most `frame_slots` such requests run at once."""
