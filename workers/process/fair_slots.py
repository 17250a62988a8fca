"""Slots that owners share: an owner with many requests delays another's by at most one of its own."""

from __future__ import annotations

import itertools
import threading
from collections import Counter, deque
from collections.abc import Callable


class FairTicket:
    """A request for a slot."""

    def __init__(self, owner: str, on_turn: Callable[[], None]) -> None:
        self.owner, self._on_turn = owner, on_turn
        self.granted = False
        """Whether it has a slot."""

    def grant(self) -> None:
        self.granted = True
        self._on_turn()


class FairSlots:
    """A free slot goes to the owner who has the fewest; of several, to the one whose last turn is longest ago; of an
    owner's tickets to the oldest. Thread-safe.

    Args:
        most: number of slots.
        most_each: maximum number of slots of one owner; None: all.
    """

    def __init__(self, most: int, most_each: int | None = None) -> None:
        self._most, self._most_each = most, most if most_each is None else most_each
        self._lock = threading.Lock()
        self._held: Counter[str] = Counter()
        self._waiting: dict[str, deque[FairTicket]] = {}
        self._turns = itertools.count(1)
        self._last_turn: dict[str, int] = {}
        """Number of the latest turn by owner, for owners who hold a slot or wait for one."""

    @property
    def held(self) -> int:
        """Number of slots in use."""
        return self._held.total()

    def enter(self, owner: str, on_turn: Callable[[], None] = lambda: None) -> FairTicket:
        """Ask for a slot. `on_turn` is called once the ticket has it: in any thread, perhaps before this returns."""
        ticket = FairTicket(owner, on_turn)
        with self._lock:
            self._waiting.setdefault(owner, deque()).append(ticket)
            self._grant()
        return ticket

    def leave(self, ticket: FairTicket) -> None:
        """Return the slot, or give up waiting. Once for each ticket."""
        owner = ticket.owner
        with self._lock:
            if ticket.granted:
                self._held[owner] -= 1
            else:
                self._waiting[owner].remove(ticket)
                self._forget_waiting(owner)
            if not self._held[owner]:
                del self._held[owner]
            self._grant()
            if owner not in self._held and owner not in self._waiting:
                self._last_turn.pop(owner, None)

    def _grant(self) -> None:
        while self._held.total() < self._most:
            owners = [owner for owner in self._waiting if self._held[owner] < self._most_each]
            if not owners:
                return
            owner = min(owners, key=lambda each: (self._held[each], self._last_turn.get(each, 0)))
            ticket = self._waiting[owner].popleft()
            self._forget_waiting(owner)
            self._held[owner] += 1
            self._last_turn[owner] = next(self._turns)
            ticket.grant()

    def _forget_waiting(self, owner: str) -> None:
        if not self._waiting[owner]:
            del self._waiting[owner]


def fair_share(free: int, own: int) -> bool:
    """Whether an owner of `own` slots may take one of `free` ones that cannot be taken away again, such as a live
    session: an owner may have as many as remain free afterwards, plus one (dynamic thresholds, Choudhury and Hahne,
    1998). So a single owner has about half of all, and there is always one for an owner who has none."""
    return free > own
