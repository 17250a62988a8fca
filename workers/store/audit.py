"""Who did what. Rows are only added; `prune` removes those that are older than they must be kept."""

from __future__ import annotations

from dataclasses import replace

from sqlalchemy import delete, insert, or_, select

from workers.contract.owners import AuditEntry
from workers.contract.record import Page
from workers.ids import new_id
from workers.store import schema
from workers.store.base import StorePart
from workers.store.records import pack_cursor, unpack_cursor


class Audit(StorePart):
    """Entries, newest first."""

    def add(self, *entries: AuditEntry) -> None:
        """Record actions that have been done. Their ids and times are given here."""
        rows = [vars(replace(entry, id=new_id("aud_"), at=self._now())) for entry in entries]
        if rows:
            with self._db.write() as connection:
                connection.execute(insert(schema.audit), rows)

    def page(
        self, who: str | None = None, action: str | None = None, about: str | None = None,
        cursor: str | None = None, limit: int = 50,
    ) -> Page:  # fmt: skip
        """`AuditEntry` items, newest first.

        Args:
            who: only what this user did, or was done for this owner.
            action: only this operation.
            about: only what was done to the object with this id.
        """
        table = schema.audit
        query = select(table).order_by(table.c.id.desc()).limit(limit + 1)
        if who is not None:
            query = query.where(or_(table.c.user == who, table.c.owner == who))
        if action is not None:
            query = query.where(table.c.action == action)
        if about is not None:
            query = query.where((" " + table.c.object + " ").contains(f" {about} ", autoescape=True))
        if cursor is not None:
            query = query.where(table.c.id < unpack_cursor(cursor, str)[0])
        with self._db.read() as connection:
            rows = connection.execute(query).mappings().all()
        items = tuple(AuditEntry(**row) for row in rows[:limit])
        return Page(items, pack_cursor(items[-1].id) if len(rows) > limit else None)

    def prune(self, age_s: float) -> int:
        """Delete entries that are older; returns their number."""
        with self._db.write() as connection:
            table = schema.audit
            return connection.execute(delete(table).where(table.c.at < self._now() - age_s)).rowcount
