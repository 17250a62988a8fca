"""Dependencies of routes: the caller, with the scope that the route needs, and the service's context."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Annotated, cast

from anyio import CapacityLimiter
from fastapi import Depends, Request, Security
from fastapi.security import HTTPAuthorizationCredentials, HTTPBearer
from prometheus_client import CollectorRegistry

from service.access.admission import Admission
from service.access.keys import EVERYONE, Principal, Scope
from service.access.provider import Provider
from service.context.load_history import LoadHistory
from service.errors import Forbidden
from service.settings import Settings
from service.styles.library import StyleLibrary
from service.webhooks.secrets import WebhookSecrets
from workers.farm import Farm
from workers.process.fair_slots import fair_share

HISTORIES = 8
"""Number of event streams whose history is read at once."""
DOWNLOADS = 16
"""Number of downloaded chunks that are read from the blob store at once."""


class Streams:
    """Open event streams. One that waits for an event has no thread; their histories are read in few, which no other
    request uses."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._open: Counter[str] = Counter()
        self.threads = CapacityLimiter(HISTORIES)

    def full(self, owner: Principal) -> bool:
        """Whether this owner may open none now: all are taken, or it has its share (`fair_share`)."""
        free = self._most - self.count()
        return free <= 0 or not (owner is EVERYONE or fair_share(free, self._open[owner.owner]))

    def count(self) -> int:
        """Number of open streams."""
        return self._open.total()

    @contextmanager
    def one(self, owner: Principal) -> Iterator[None]:
        """Count a stream while the block runs. Call it on the event loop only."""
        self._open[owner.owner] += 1
        try:
            yield
        finally:
            self._open -= Counter([owner.owner])


@dataclass
class ServiceContext:
    """Shared objects of all routes: settings, farm, semaphores, metrics. Created by `create_app`."""

    settings: Settings
    farm: Farm
    streams: Streams
    preview_threads: CapacityLimiter
    """Threads in which previews of projects are made, so that they cannot block other requests."""
    admission: Admission
    """Slots of requests, by the class of their cost."""
    webhook_secrets: WebhookSecrets
    styles: StyleLibrary
    provider: Provider | None
    """Where users sign in; None: keys only."""
    registry: CollectorRegistry
    """Registry of this app's metrics."""
    download_threads: CapacityLimiter = field(default_factory=lambda: CapacityLimiter(DOWNLOADS))
    """Threads in which downloads are read: a blob store that answers slowly must not block other requests."""
    load: LoadHistory = field(default_factory=LoadHistory)
    """Load of this machine over the last hour."""
    closing: threading.Event = field(default_factory=threading.Event)
    """Set when the process is about to stop: event streams end."""


async def _context(request: Request) -> ServiceContext:  # async: no thread is needed, nothing blocks
    return cast(ServiceContext, request.app.state.service)


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
Anyone = Annotated[Principal, Depends(_requires())]
"""A caller with a key of any scope."""
Reader = Annotated[Principal, Depends(_requires(Scope.READ))]
Submitter = Annotated[Principal, Depends(_requires(Scope.SUBMIT))]
Sharer = Annotated[Principal, Depends(_requires(Scope.SUBMIT, Scope.READ))]
"""A caller who lets others read; a caller can share only what the caller may read."""
Admin = Annotated[Principal, Depends(_requires(Scope.ADMIN))]
