"""Slots that owners share."""

from __future__ import annotations

import itertools
import threading
from collections.abc import Iterator
from functools import partial
from typing import Any

import pytest

from pipeline.errors import ImpastoError
from tests.waiting import until
from workers.contract.request import Json
from workers.live.sessions import LiveSessions
from workers.live.worker import NoLiveWorker
from workers.previews.model import PreviewQuery, Record
from workers.previews.service import PreviewService
from workers.process.fair_slots import FairSlots
from workers.settings import FarmSettings


def test_owners_take_turns() -> None:
    slots, served = FairSlots(1), list[str]()
    tickets = {slots.enter(owner, partial(served.append, owner)) for owner in "aaaaabbc"}
    while tickets:
        (ticket,) = (ticket for ticket in tickets if ticket.granted)
        tickets.remove(ticket)
        slots.leave(ticket)
    assert served == list("abcabaaa")


def test_an_owner_has_at_most_its_number_of_slots() -> None:
    slots = FairSlots(4, 3)
    anna = [slots.enter("anna") for _ in range(5)]
    assert [ticket.granted for ticket in anna] == [True] * 3 + [False] * 2
    ben = slots.enter("ben")
    assert ben.granted
    slots.leave(ben)
    assert not anna[3].granted
    slots.leave(anna[3])
    slots.leave(anna[0])
    assert anna[4].granted and slots.held == 3
    for ticket in (anna[1], anna[2], anna[4]):
        slots.leave(ticket)
    assert slots.held == 0


class _Runner:
    """Records who is served, and works until it may go on."""

    def __init__(self) -> None:
        self.served: list[str] = []
        self.go = threading.Semaphore(0)

    def start(self) -> None: ...

    def run(self, query: PreviewQuery, _check: Any) -> Iterator[Record]:
        self.served.append(query.project)
        assert self.go.acquire(timeout=20)
        yield Record({"type": "end"})

    def state(self) -> Json:
        return {}

    def close(self) -> None: ...


def test_an_owners_preview_waits_for_one_of_each_other_owner() -> None:
    """Twenty previews of anna wait when ben's comes: his is the next."""
    runner = _Runner()
    service, numbers = PreviewService(runner, 1), itertools.count()

    def ask(owner: str) -> threading.Thread:
        name = f"{owner}-{next(numbers)}"
        query = PreviewQuery("paint", owner, name, "stage", 0, (), 64, {})
        run = service.start(query, owner)
        run.ready()  # it waits from now on
        thread = threading.Thread(target=lambda: list(run))
        thread.start()
        return thread

    asked = [ask("anna") for _ in range(20)]
    until(lambda: len(runner.served) == 1)
    asked.append(ask("ben"))
    runner.go.release(21)
    for thread in asked:
        thread.join(20)
    assert runner.served[1] == "ben" and len(runner.served) == 21


@pytest.mark.parametrize(("capacity", "most"), [(1, 1), (2, 1), (3, 2), (8, 4)])
def test_an_owner_cannot_take_all_live_sessions(capacity: int, most: int) -> None:
    live = LiveSessions(None, FarmSettings(live_sessions=capacity))  # type: ignore[arg-type]
    held = []
    with pytest.raises(NoLiveWorker) as refused:
        while True:
            held.append(live.place("anna"))
    assert len(held) == most and isinstance(refused.value, ImpastoError) and refused.value.remedy
    if capacity > 1:
        ben = live.place("ben")
        ben.release()
    held[0].release()
    held[0].release()
    assert live.place("anna")


def test_the_only_user_and_a_key_with_a_quota_have_no_share() -> None:
    live = LiveSessions(None, FarmSettings(live_sessions=4))  # type: ignore[arg-type]
    held = [live.place(None) for _ in range(4)]
    assert live.free == 0
    for slot in held:
        slot.release()
    assert [live.place("anna", most=3) for _ in range(3)]
    with pytest.raises(NoLiveWorker):
        live.place("anna", most=3)
