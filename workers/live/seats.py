"""Where the work of sessions runs: a *seat* a session. Threads of this process (`local_seats`), or Ray actors."""

from __future__ import annotations

from collections.abc import Awaitable, Mapping
from typing import Protocol

from pipeline.errors import ImpastoError
from workers.live.model import LiveOrder, Painted, Work
from workers.model import Json


class SeatLost(ImpastoError):
    """The process of a seat died. What it had in work is lost; the session may take another seat."""

    code = "worker-lost"


class NoSeat(ImpastoError):
    """Every seat is taken."""

    code = "busy"

    def __init__(self, message: str, *, retry_after_s: float = 5.0, **parts: object) -> None:
        super().__init__(message, **parts)  # type: ignore[arg-type]
        self.retry_after_s = retry_after_s


class Seat(Protocol):
    """A `LivePainter` somewhere. Calls are submitted at once, in the order of the calls, and raise `SeatLost` besides
    what the painter raises. For one loop only.

    `look` and `paint` of a frame are called together: `paint` waits where the work is done.
    """

    def open(self, order: LiveOrder) -> Awaitable[None]: ...
    def look(self, work: Work) -> Awaitable[None]: ...
    def paint(self) -> Awaitable[Painted]: ...
    def change(self, params: Mapping[str, Json], inputs: Mapping[str, str]) -> Awaitable[None]: ...
    async def leave(self) -> None:
        """Give it back. Never raises; waits for nothing but what runs."""
        ...


class Seats(Protocol):
    kind: str
    """"local" or "ray"."""

    def start(self) -> None:
        """Get ready; on the main thread."""
        ...

    async def take(self) -> Seat:
        """A seat, warm if there is one. Raises NoSeat: none can be had in time."""
        ...

    def stop(self) -> None: ...
