"""What routes ask for: who is calling (with the right scope) and the parts of the service."""

from __future__ import annotations

import threading
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Annotated, cast

from anyio import CapacityLimiter
from fastapi import Depends, Request, Security
from fastapi.security import HTTPAuthorizationCredentials, HTTPBearer
from prometheus_client import CollectorRegistry

from service.access.keys import Principal, Scope
from service.errors import Forbidden
from service.settings import Settings
from service.webhooks.secrets import WebhookSecrets
from workers.farm import Farm


class Streams:
    """Counts event streams, and keeps their waiting threads apart from those that serve requests."""

    def __init__(self, most: int) -> None:
        self._most, self._open = most, 0
        self.threads = CapacityLimiter(most)

    @property
    def full(self) -> bool:
        return self._open >= self._most

    def count(self) -> int:
        """Streams open now."""
        return self._open

    @contextmanager
    def one(self) -> Iterator[None]:
        """Count a stream while it lasts. Called on the event loop only."""
        self._open += 1
        try:
            yield
        finally:
            self._open -= 1


@dataclass
class Service:
    """The parts that routes work with; made by `create_app`."""

    settings: Settings
    farm: Farm
    streams: Streams
    previews: threading.BoundedSemaphore
    """Paintings of one frame that may be made at once."""
    frames: threading.BoundedSemaphore
    """Frames of assets that may be decoded at once."""
    webhook_secrets: WebhookSecrets
    registry: CollectorRegistry
    """Of this app's metrics."""
    closing: threading.Event = field(default_factory=threading.Event)
    """Set when the process is about to stop: long answers end."""


async def _service(request: Request) -> Service:  # not on a thread: it waits for nothing
    return cast(Service, request.app.state.service)


bearer = HTTPBearer(auto_error=False, description="An API key; not needed on loopback unless the operator says so.")


def _needs(scope: Scope) -> Callable[..., Awaitable[Principal]]:
    async def caller(
        request: Request, _documented: Annotated[HTTPAuthorizationCredentials | None, Security(bearer)] = None
    ) -> Principal:
        principal = cast(Principal, request.state.principal)
        if principal.may(scope):
            return principal
        raise Forbidden(
            f"This key may not do that: it lacks the scope {scope.value!r}.",
            field="Authorization",
            value=", ".join(sorted(principal.scopes)),
            remedy=f"Use a key with the scope {scope.value!r}.",
        )

    return caller


Parts = Annotated[Service, Depends(_service)]
Reader = Annotated[Principal, Depends(_needs(Scope.READ))]
Submitter = Annotated[Principal, Depends(_needs(Scope.SUBMIT))]
Admin = Annotated[Principal, Depends(_needs(Scope.ADMIN))]
