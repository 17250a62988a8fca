"""Assets in the database. The same bytes are one asset, which may have several owners."""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Iterable
from dataclasses import asdict
from typing import Any

from sqlalchemy import (
    JSON,
    ColumnElement,
    Connection,
    Select,
    String,
    cast,
    delete,
    func,
    insert,
    literal,
    select,
)

from workers.contract.record import ANY_OWNER, AnyOwner, Asset, Page, RunState
from workers.errors import Conflict, NotFound
from workers.store import schema
from workers.store.base import StorePart
from workers.store.records import asset_of, pack_cursor, unpack_cursor

_FINAL = [state.value for state in RunState if state.final]


class Assets(StorePart):
    """Assets by id."""

    def add(self, asset: Asset, still_there: Callable[[], bool]) -> Asset | None:
        """Add `asset`, or a further owner of a known one; None if its bytes have been deleted meanwhile.

        Args:
            still_there: whether the bytes exist; called inside the transaction, so that a concurrent `delete` cannot
                leave a row without bytes.
        """
        with self._db.write() as connection:
            self._db.lock(connection, asset.id)
            if not still_there():
                return None
            if _find(connection, asset.id) is None:
                connection.execute(insert(schema.assets).values(asdict(asset)))
            _add_owner(connection, asset)
        return self.get(asset.id, asset.owner)

    def get(self, asset_id: str, owner: str | AnyOwner) -> Asset:
        """The asset with that owner's file name and time (`ANY_OWNER`: the first owner's). Raises NotFound."""
        with self._db.read() as connection:
            found = _find(connection, asset_id) if owner is ANY_OWNER else _find_owned(connection, asset_id, owner)
        if found is None:
            raise _unknown(asset_id)
        return found

    def owned(self, asset_ids: Iterable[str], owner: str) -> dict[str, Asset]:
        """id -> asset, with the owner's file name and time, for those of the assets that the owner has."""
        _, key, query = _listing(owner)
        with self._db.read() as connection:
            rows = connection.execute(query.where(key.in_(self._listed(sorted(set(asset_ids)))))).mappings().all()
        return {asset.id: asset for asset in map(asset_of, rows)}

    def _listed(self, texts: list[str]) -> Select[Any]:
        """The texts as a subquery with one parameter: a statement with thousands of them takes long to build."""
        given = literal(json.dumps(texts), String)
        unpacked = func.json_each(given) if self._db.is_sqlite else func.json_array_elements_text(cast(given, JSON))
        return select(unpacked.table_valued("value").c.value)

    def owners(self, owners: Collection[str]) -> set[str]:
        """Those of the owners who have an asset."""
        table = schema.asset_owners
        query = select(table.c.owner).where(table.c.owner.in_(list(owners))).distinct()
        with self._db.read() as connection:
            return set(connection.execute(query).scalars())

    def page(self, owner: str | AnyOwner, cursor: str | None = None, limit: int = 50) -> Page:
        """Newest first."""
        at, key, query = _listing(owner)
        if cursor is not None:
            when, last = unpack_cursor(cursor, float, str)
            query = query.where((at < when) | ((at == when) & (key < last)))
        with self._db.read() as connection:
            rows = connection.execute(query.order_by(at.desc(), key.desc()).limit(limit + 1)).mappings().all()
        items = [asset_of(row) for row in rows[:limit]]
        more = len(rows) > limit
        return Page(tuple(items), pack_cursor(items[-1].created_at, items[-1].id) if more else None)

    def remove(self, asset_id: str, owner: str | AnyOwner) -> bool:
        """Delete the entry of `owner` (`ANY_OWNER`: of all owners); returns whether its bytes are no longer needed.

        Raises:
            NotFound: there is no such asset (of that owner).
            Conflict: a job that is not final, or a project, uses it.
        """
        self.get(asset_id, owner)
        with self._db.write() as connection:
            table, owners = schema.assets, schema.asset_owners
            self._db.lock(connection, asset_id)
            connection.execute(select(table.c.id).where(table.c.id == asset_id).with_for_update()).first()
            _refuse_if_used(connection, asset_id, owner)
            mine = () if owner is ANY_OWNER else (owners.c.owner == owner,)
            connection.execute(delete(owners).where(owners.c.asset_id == asset_id, *mine))
            left = connection.execute(select(owners.c.owner).where(owners.c.asset_id == asset_id).limit(1)).first()
            if left is None:
                connection.execute(delete(table).where(table.c.id == asset_id))
            return left is None

    def knows(self, asset_id: str) -> bool:
        with self._db.read() as connection:
            return _find(connection, asset_id) is not None

    def unless_known(self, asset_id: str, forget: Callable[[], None]) -> None:
        """Call `forget` if the asset is unknown; it cannot be added meanwhile."""
        with self._db.write() as connection:
            self._db.lock(connection, asset_id)
            if _find(connection, asset_id) is None:
                forget()


def _find(connection: Connection, asset_id: str) -> Asset | None:
    row = connection.execute(select(schema.assets).where(schema.assets.c.id == asset_id)).mappings().first()
    return None if row is None else asset_of(row)


def _find_owned(connection: Connection, asset_id: str, owner: str) -> Asset | None:
    _, key, query = _listing(owner)
    row = connection.execute(query.where(key == asset_id)).mappings().first()
    return None if row is None else asset_of(row)


def _listing(owner: str | AnyOwner) -> tuple[ColumnElement[float], ColumnElement[str], Select[Any]]:
    """(time, id, query) of all assets, or of one owner's."""
    table, owners = schema.assets, schema.asset_owners
    if owner is ANY_OWNER:
        return table.c.created_at, table.c.id, select(table)
    own = ("filename", "created_at", "owner")
    columns = [column for column in table.c if column.name not in own] + [owners.c[name] for name in own]
    query = select(*columns).join(owners, owners.c.asset_id == table.c.id).where(owners.c.owner == owner)
    return owners.c.created_at, table.c.id, query


def _add_owner(connection: Connection, asset: Asset) -> None:
    owners = schema.asset_owners
    known = select(owners.c.owner).where(owners.c.asset_id == asset.id, owners.c.owner == asset.owner)
    if connection.execute(known).first() is None:
        names = {"owner": asset.owner, "asset_id": asset.id, "filename": asset.filename}
        values = {**names, "created_at": asset.created_at}
        connection.execute(insert(owners).values(values))


def _refuse_if_used(connection: Connection, asset_id: str, owner: str | AnyOwner) -> None:
    job_id = _user(connection, asset_id, owner)
    if job_id is not None:
        remedy = "Cancel the job, or wait until it has ended."
        raise Conflict(f"The job {job_id} uses this asset.", field="asset", value=asset_id, remedy=remedy)
    name = _project(connection, asset_id, owner)
    if name is not None:
        remedy = "Delete the project first; a deleted one lets go of its assets when it can be restored no more."
        raise Conflict(f"The project {name!r} uses this asset.", field="asset", value=asset_id, remedy=remedy)


def _user(connection: Connection, asset_id: str, owner: str | AnyOwner) -> str | None:
    """A job (of `owner`) that uses the asset and is not final."""
    jobs, inputs = schema.jobs, schema.job_inputs
    query = (
        select(jobs.c.id)
        .join(inputs, inputs.c.job_id == jobs.c.id)
        .where(inputs.c.asset_id == asset_id, jobs.c.state.not_in(_FINAL))
        .limit(1)
    )
    if owner is not ANY_OWNER:
        query = query.where(jobs.c.owner == owner)
    return connection.execute(query).scalar()


def _project(connection: Connection, asset_id: str, owner: str | AnyOwner) -> str | None:
    """Name of a project (of `owner`) of which a version names the asset, and whose owner has it."""
    projects, named, owners = schema.projects, schema.project_assets, schema.asset_owners
    has = (owners.c.owner == projects.c.owner) & (owners.c.asset_id == named.c.asset_id)
    query = select(projects.c.name).join(named, named.c.project_id == projects.c.id).join(owners, has)
    query = query.where(named.c.asset_id == asset_id).limit(1)
    if owner is not ANY_OWNER:
        query = query.where(projects.c.owner == owner)
    return connection.execute(query).scalar()


def _unknown(asset_id: str) -> NotFound:
    return NotFound(f"There is no asset {asset_id}.", field="asset", value=asset_id, remedy="Upload it first.")
