"""The outbox of webhook messages. A message is written in the transaction that ends its job.

Retries follow the schedule of Standard Webhooks 1.0.0: at once, 5 s, 5 min, 30 min, 2 h, 5 h, 10 h, 10 h.
"""

from __future__ import annotations

from sqlalchemy import select, update

from workers.contract.record import Delivery
from workers.contract.request import Json
from workers.errors import NotFound
from workers.store import schema
from workers.store.base import StorePart
from workers.store.records import delivery_of

WAITS_S = (5.0, 300.0, 1800.0, 7200.0, 18000.0, 36000.0, 36000.0)
"""Delays after each failed try, seconds; after one more failure the message is dropped."""
_GONE = 410


class Webhooks(StorePart):
    """The sender's loop: `for d in due(): status = post(d); record(d.id, status, error)`."""

    def due(self, limit: int = 20, lease_s: float = 60.0) -> list[Delivery]:
        """Claim messages to send now. One that is not recorded within `lease_s` becomes due again."""
        table, now = schema.deliveries, self._now()
        query = (
            select(table)
            .where(table.c.state == "waiting", table.c.next_at <= now)
            .order_by(table.c.next_at)
            .limit(limit)
        )
        with self._db.read() as connection:  # the outbox is nearly always empty: check that without a write lock
            if connection.execute(query).first() is None:
                return []
        with self._db.write() as connection:
            found = [delivery_of(row) for row in connection.execute(query.with_for_update(skip_locked=True)).mappings()]
            claimed = table.c.id.in_([delivery.id for delivery in found])
            connection.execute(update(table).where(claimed).values(next_at=now + lease_s))
        return found

    def record(self, delivery_id: str, status: int | None, error: str = "") -> Delivery:
        """Record the outcome of one try. HTTP 2xx: delivered. 410 (gone): dead. Otherwise (None: no answer) the message
        waits for a longer time after each try, and finally is dead. Raises NotFound."""
        table = schema.deliveries
        with self._db.write() as connection:
            query = select(table).where(table.c.id == delivery_id).with_for_update()
            row = connection.execute(query).mappings().first()
            if row is None:
                raise NotFound(f"There is no message {delivery_id}.", field="delivery", value=delivery_id)
            values = _after_try(row["tries"] + 1, status, error, self._now())
            connection.execute(update(table).where(table.c.id == delivery_id).values(values))
            return delivery_of({**row, **values})

    def of_job(self, job_id: str) -> list[Delivery]:
        """All messages about a job, oldest first."""
        table = schema.deliveries
        query = select(table).where(table.c.job_id == job_id).order_by(table.c.id)
        with self._db.read() as connection:
            return [delivery_of(row) for row in connection.execute(query).mappings()]


def _after_try(tries: int, status: int | None, error: str, now: float) -> Json:
    if status is not None and 200 <= status < 300:
        return {"tries": tries, "state": "delivered", "next_at": None, "last_error": ""}
    reason = error or ("no answer" if status is None else f"HTTP {status}")
    if status == _GONE or tries > len(WAITS_S):
        return {"tries": tries, "state": "dead", "next_at": None, "last_error": reason}
    return {"tries": tries, "state": "waiting", "next_at": now + WAITS_S[tries - 1], "last_error": reason}
