"""Slot time that owners have used, for turns: start-time fair queueing (Goyal, Vin and Cheng, 1996).

`shares.used_s` grows by the duration of each attempt of the owner. At a claim, the least value among the owners who
have a ready task is stored as `shares.floor_s`. It only grows. An owner counts as having used no less than the largest
floor, so that time without work is not saved up, and at most `DEBT_S` more, so that one long task on an idle farm does
not exclude its owner for as long afterwards. A claim reads one row of each such owner, and the end of an index.
"""

from __future__ import annotations

from sqlalchemy import Connection, bindparam, func, select, text, update

from workers.store import schema

DEBT_S = 600.0
"""Maximum slot time by which an owner can be behind the others, seconds."""

# Built once, because building a statement takes longer than running it.
FLOOR = select(func.coalesce(func.max(schema.shares.c.floor_s), 0.0)).scalar_subquery()
"""Slot time that every owner counts as having used, seconds."""
_TAKE_TURN = text(
    "INSERT INTO shares (owner, used_s, floor_s) VALUES (:owner, :floor_s, :floor_s)"
    " ON CONFLICT (owner) DO UPDATE SET"
    " used_s = CASE WHEN shares.used_s < :floor_s THEN :floor_s WHEN shares.used_s > :most_s THEN :most_s"
    " ELSE shares.used_s END,"
    " floor_s = CASE WHEN shares.floor_s < :floor_s THEN :floor_s ELSE shares.floor_s END"
)
_CHARGE = (
    update(schema.shares)
    .where(schema.shares.c.owner == bindparam("of"))
    .values(used_s=schema.shares.c.used_s + bindparam("seconds"))
)


def counted_s(used_s: float | None, floor_s: float) -> float:
    """Slot time that an owner counts as having used, seconds; None: the owner has no row yet."""
    return min(max(used_s or 0.0, floor_s), floor_s + DEBT_S)


def take_turn(connection: Connection, owner: str, floor_s: float) -> None:
    """A task of the owner was claimed; `floor_s`: the least slot time of all who wait."""
    connection.execute(_TAKE_TURN, {"owner": owner, "floor_s": floor_s, "most_s": floor_s + DEBT_S})


def charge(connection: Connection, owner: str, seconds: float) -> None:
    """An attempt of the owner has ended after `seconds`."""
    connection.execute(_CHARGE, {"of": owner, "seconds": seconds})
