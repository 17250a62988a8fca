"""Assets in the database. The same bytes are one asset, which several owners may hold."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict

from sqlalchemy import Connection, delete, insert, select

from workers.errors import Conflict, NotFound
from workers.farm import Page
from workers.model import Asset, RunState
from workers.store import schema
from workers.store.base import Base
from workers.store.records import asset_of, pack_cursor, unpack_cursor

_FINAL = [state.value for state in RunState if state.final]


class Assets(Base):
    """Assets by id."""

    def add(self, asset: Asset, still_there: Callable[[], bool]) -> Asset | None:
        """Keep `asset`, or note a further owner of one that is known; None if its bytes have gone meanwhile.

        Args:
            still_there: asked inside the transaction, so that a `delete` beside us cannot leave a row without bytes.
        """
        with self._db.write() as connection:
            if not still_there():
                return None
            known = _find(connection, asset.id)
            if known is None:
                connection.execute(insert(schema.assets).values(asdict(asset)))
            _hold(connection, asset)
            return known or asset

    def get(self, asset_id: str) -> Asset:
        with self._db.read() as connection:
            found = _find(connection, asset_id)
        if found is None:
            raise _unknown(asset_id)
        return found

    def page(self, owner: str | None = None, cursor: str | None = None, limit: int = 50) -> Page:
        """Newest first."""
        table, owners = schema.assets, schema.asset_owners
        query = select(table).order_by(table.c.created_at.desc(), table.c.id.desc()).limit(limit + 1)
        if owner is not None:
            query = query.join(owners, owners.c.asset_id == table.c.id).where(owners.c.owner == owner)
        if cursor is not None:
            at, last = unpack_cursor(cursor, float, str)
            query = query.where((table.c.created_at < at) | ((table.c.created_at == at) & (table.c.id < last)))
        with self._db.read() as connection:
            items = [asset_of(row) for row in connection.execute(query).mappings()]
        more = len(items) > limit
        items = items[:limit]
        return Page(tuple(items), pack_cursor(items[-1].created_at, items[-1].id) if more else None)

    def owners(self, asset_id: str) -> set[str]:
        owners = schema.asset_owners
        with self._db.read() as connection:
            return set(connection.execute(select(owners.c.owner).where(owners.c.asset_id == asset_id)).scalars())

    def remove(self, asset_id: str) -> None:
        """Raises NotFound, or Conflict while a job that is not final uses it."""
        with self._db.write() as connection:
            table = schema.assets
            locked = connection.execute(select(table.c.id).where(table.c.id == asset_id).with_for_update()).first()
            if locked is None:
                raise _unknown(asset_id)
            job_id = _user(connection, asset_id)
            if job_id is not None:
                raise Conflict(
                    f"The job {job_id} uses this asset.",
                    field="asset",
                    value=asset_id,
                    remedy="Cancel the job, or wait until it has ended.",
                )
            connection.execute(delete(table).where(table.c.id == asset_id))

    def unless_known(self, asset_id: str, forget: Callable[[], None]) -> None:
        """Call `forget` if the asset is (still) unknown, while nobody can add it."""
        with self._db.write() as connection:
            if _find(connection, asset_id) is None:
                forget()


def _find(connection: Connection, asset_id: str) -> Asset | None:
    row = connection.execute(select(schema.assets).where(schema.assets.c.id == asset_id)).mappings().first()
    return None if row is None else asset_of(row)


def _hold(connection: Connection, asset: Asset) -> None:
    owners = schema.asset_owners
    held = select(owners.c.owner).where(owners.c.asset_id == asset.id, owners.c.owner == asset.owner)
    if connection.execute(held).first() is None:
        connection.execute(insert(owners).values(owner=asset.owner, asset_id=asset.id))


def _user(connection: Connection, asset_id: str) -> str | None:
    jobs, inputs = schema.jobs, schema.job_inputs
    query = (
        select(jobs.c.id)
        .join(inputs, inputs.c.job_id == jobs.c.id)
        .where(inputs.c.asset_id == asset_id, jobs.c.state.not_in(_FINAL))
        .limit(1)
    )
    return connection.execute(query).scalar()


def _unknown(asset_id: str) -> NotFound:
    return NotFound(f"There is no asset {asset_id}.", field="asset", value=asset_id, remedy="Upload it first.")
