"""`farm.previews`: queries in, records out; a later query of the same client and channel cancels the earlier ones."""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Protocol

from pipeline.errors import Cancelled
from workers.contract.request import Json
from workers.previews.costs import COST, PreviewCosts
from workers.previews.memory import Check
from workers.previews.model import SINGLE, Overtaken, PreviewQuery, Record
from workers.previews.single import PreviewJob
from workers.process.fair_slots import FairSlots, FairTicket

_FORGET = 10_000
"""Maximum number of clients and channels that are tracked; beyond it, those with the oldest query are dropped."""
SLOT_POLL_S = 0.02
"""Interval at which waiting previews check for a free slot, seconds."""


class PreviewRunner(Protocol):
    """Runs previews: in this process (`local_runner`), or in Ray actors (`ray_runner`)."""

    def start(self) -> None:
        """Get ready for the first query. With Ray: once it is connected."""
        ...

    def run(self, query: PreviewQuery, check: Check) -> Iterator[Record]:
        """Yield the records of the answer. `check` raises an error once they are no longer needed."""
        ...

    def state(self) -> Json:
        """Cached bytes, their limit, number of restarts, and the place where previews are computed."""
        ...

    def close(self) -> None: ...


@dataclass
class _Ticket:
    """A query in progress."""

    query: PreviewQuery
    owner: str
    by: int | None = None
    """`seq` of the later query that has cancelled it; None: none has."""
    left: threading.Event = field(default_factory=threading.Event)
    """Set when the client has disconnected."""
    slot: FairTicket | None = None
    """Place in the queue of slots, from the first request to the end."""

    def check(self) -> None:
        if self.by is not None:
            raise Overtaken(self.by)
        if self.left.is_set():
            raise Cancelled("The client of this preview has left.")


class PreviewRun:
    """An answer in progress: iterate over it, and close it. Iterating waits in this thread for a slot; a caller that
    must not wait calls `ready` first."""

    def __init__(self, service: PreviewService, ticket: _Ticket) -> None:
        self._service, self._ticket = service, ticket

    def ready(self) -> bool:
        """Whether the answer can begin; takes a free slot if there is one."""
        return self._service.take_slot(self._ticket)

    def cancel(self) -> None:
        """Stop soon, because the answer is no longer needed."""
        self._ticket.left.set()

    def close(self) -> None:
        """Return the slot, also if no record was requested."""
        self._service.leave_slot(self._ticket)

    def __iter__(self) -> Iterator[Record]:
        return self._service.answer(self._ticket)


class PreviewService:
    """Runs preview queries and cancels those that a later query replaces. Thread-safe.

    Args:
        runner: makes the previews.
        slots: number of previews that are made at once. Others wait, owners in turn, and end if a later query cancels
            them meanwhile.
    """

    def __init__(self, runner: PreviewRunner, slots: int) -> None:
        self._runner = runner
        self.costs = PreviewCosts()
        self._slots = FairSlots(slots)
        self._lock = threading.Lock()
        self._latest: dict[tuple[str, str, str], _Ticket] = {}
        self._singles = itertools.count(1)

    def start_runner(self) -> None:
        """Get ready for the first query. With Ray: once it is connected."""
        self._runner.start()

    def start(self, query: PreviewQuery, owner: str = "") -> PreviewRun:
        """Start a query. It cancels earlier ones, or is cancelled at once if a later one has already arrived.

        Args:
            owner: who waits for it.
        """
        ticket, name = _Ticket(query, owner), (query.project, query.client, query.channel)
        with self._lock:
            before = self._latest.pop(name, None)
            if before is not None and before.query.seq > query.seq:
                ticket.by = before.query.seq
                self._latest[name] = before
            else:
                if before is not None:
                    before.by = query.seq
                self._latest[name] = ticket
            while len(self._latest) > _FORGET:
                self._latest.pop(next(iter(self._latest)))
        return PreviewRun(self, ticket)

    def frame(self, job: PreviewJob, owner: str = "") -> bytes:
        """One frame of a job that is not submitted, PNG. No other query cancels it. With Ray, previews of one video are
        made in one actor. `owner` waits for it, in turns with others."""
        subject, side_px, options = job.assets["video"].id, job.ask.max_side_px, {"job": job}
        query = PreviewQuery(SINGLE, subject, f"{SINGLE}-{next(self._singles)}", SINGLE, 0, (), side_px, options)
        (found,) = [record.payload for record in self.start(query, owner) if record.header["type"] == "frame"]
        return found

    def answer(self, ticket: _Ticket) -> Iterator[Record]:
        """Yield the records of a query. Raises ImpastoError if the query is invalid."""
        while not self.take_slot(ticket):
            time.sleep(SLOT_POLL_S)
        try:
            if ticket.by is not None:
                yield Record({"type": "begin", "seq": ticket.query.seq})
                yield Record({"type": "overtaken", "by": ticket.by})
                return
            ticket.check()
            for record in self._runner.run(ticket.query, ticket.check):
                if record.header["type"] == COST:
                    self.costs.keep(record.header)
                else:
                    yield record
        finally:
            self.leave_slot(ticket)

    def take_slot(self, ticket: _Ticket) -> bool:
        """Take a slot if one is free. Returns whether the ticket need not wait: it has a slot, or its answer is no
        longer needed."""
        with self._lock:
            if ticket.by is not None or ticket.left.is_set():
                return True
            if ticket.slot is None:
                ticket.slot = self._slots.enter(ticket.owner)
            return ticket.slot.granted

    def leave_slot(self, ticket: _Ticket) -> None:
        """Return the ticket's slot, or its place in the queue."""
        with self._lock:
            if ticket.slot is not None:
                self._slots.leave(ticket.slot)
            ticket.slot = None

    def state(self) -> Json:
        return self._runner.state()

    def close(self) -> None:
        self._runner.close()
