"""Users and groups. Everything that is owned names one of them; a group has members with roles."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sqlalchemy import Connection, delete, insert, select, update
from sqlalchemy.exc import IntegrityError

from pipeline.errors import BadParameter
from workers.contract.owners import Member, Membership, Owner, OwnerKind, Role
from workers.errors import Conflict, NotFound
from workers.ids import new_id
from workers.store import schema
from workers.store.base import StorePart
from workers.store.records import Row, Values

QUOTAS = (
    "active_jobs", "asset_bytes", "document_bytes", "live_sessions", "requests_per_minute", "running_tasks",
)  # fmt: skip
"""Names of the limits that an owner may have instead of the service's."""
_PREFIXES = {OwnerKind.USER: "usr_", OwnerKind.GROUP: "grp_"}
_MOVED = ("jobs", "deliveries", "projects", "job_costs")
"""Tables whose rows have an owner, besides `asset_owners`."""


class Owners(StorePart):
    """Users and groups by id."""

    def all(self) -> list[Owner]:
        """All users and groups, the oldest first."""
        table = schema.owners
        with self._db.read() as connection:
            rows = connection.execute(select(table).order_by(table.c.created_at, table.c.id)).mappings().all()
        return [owner_of(row) for row in rows]

    def get(self, owner_id: str) -> Owner:
        """Raises NotFound."""
        with self._db.read() as connection:
            return _found(connection, owner_id)

    def is_active(self, owner_id: str) -> bool:
        """Whether there is such an owner, who is not disabled."""
        table = schema.owners
        query = select(table.c.id).where(table.c.id == owner_id, table.c.disabled_at.is_(None))
        with self._db.read() as connection:
            return connection.execute(query).first() is not None

    def add(self, name: str, kind: OwnerKind, quotas: Mapping[str, int] | None = None) -> Owner:
        """A new user without keys, or a new group without members. Raises BadParameter."""
        with self._db.write() as connection:
            return add_owner(connection, name, kind, quotas or {}, self._now())

    def change(
        self,
        owner_id: str,
        name: str | None = None,
        quotas: Mapping[str, int | None] | None = None,
        disabled: bool | None = None,
    ) -> Owner:
        """Change what is given.

        Args:
            quotas: limits to set; None as a limit: the service's applies again. Others stay.
            disabled: whether all keys of a user, or all members of a group, are refused.

        Raises: NotFound, BadParameter.
        """
        with self._db.write() as connection:
            old, values = _found(connection, owner_id), Values()
            if name is not None:
                check_name(name)
                values["name"] = name
            if quotas is not None:
                kept = {**old.quotas, **quotas}
                values["quotas"] = checked_quotas({each: limit for each, limit in kept.items() if limit is not None})
            if disabled is not None:
                values["disabled_at"] = (old.disabled_at or self._now()) if disabled else None
            if values:
                connection.execute(update(schema.owners).where(schema.owners.c.id == owner_id).values(values))
            return _found(connection, owner_id)

    def signed_in(self, subject: str, name: str) -> Owner:
        """The user with this subject of an OpenID provider; a new one at the first time."""
        query = select(schema.owners).where(schema.owners.c.subject == subject)
        try:
            with self._db.write() as connection:
                row = connection.execute(query).mappings().first()
                if row is not None:
                    return owner_of(row)
                return add_owner(connection, name[:100] or "?", OwnerKind.USER, {}, self._now(), subject)
        except IntegrityError:  # the same user signs in twice at once
            with self._db.read() as connection:
                return owner_of(connection.execute(query).mappings().one())

    def link(self, owner_id: str, subject: str) -> Owner:
        """Let who signs in with this subject be this user. Raises Conflict if that is another user already."""
        with self._db.write() as connection:
            _found(connection, owner_id, OwnerKind.USER)
            table = schema.owners
            other = connection.execute(
                select(table.c.id).where(table.c.subject == subject, table.c.id != owner_id)
            ).scalar()
            if other is not None:
                remedy = f"Move what {other} has to {owner_id} first: `impasto owners transfer {other} {owner_id}`."
                raise Conflict("Another user signs in so.", field="subject", value=subject, remedy=remedy)
            connection.execute(update(table).where(table.c.id == owner_id).values(subject=subject))
            return _found(connection, owner_id)

    # -- members

    def members(self, group: str) -> list[Member]:
        """The members of a group. Raises NotFound."""
        table, owners = schema.members, schema.owners
        query = (
            select(owners.c.id, owners.c.name, table.c.role)
            .join(owners, owners.c.id == table.c.user_id)
            .where(table.c.group_id == group)
            .order_by(owners.c.name, owners.c.id)
        )
        with self._db.read() as connection:
            _found(connection, group, OwnerKind.GROUP)
            return [Member(row.id, row.name, Role(row.role)) for row in connection.execute(query)]

    def memberships(self, user: str) -> list[Membership]:
        """The groups of a user, without disabled ones, by name."""
        table, owners = schema.members, schema.owners
        query = (
            select(owners.c.id, owners.c.name, table.c.role)
            .join(owners, owners.c.id == table.c.group_id)
            .where(table.c.user_id == user, owners.c.disabled_at.is_(None))
            .order_by(owners.c.name, owners.c.id)
        )
        with self._db.read() as connection:
            return [Membership(row.id, row.name, Role(row.role)) for row in connection.execute(query)]

    def role(self, user: str, group: str) -> tuple[Role | None, dict[str, int]] | None:
        """The role of a user in a group (None: no member), and the group's quotas; None: there is no such group, or it
        is disabled."""
        table, owners = schema.members, schema.owners
        own = (table.c.group_id == owners.c.id) & (table.c.user_id == user)
        query = (
            select(table.c.role, owners.c.quotas)
            .select_from(owners.outerjoin(table, own))
            .where(owners.c.id == group, owners.c.kind == OwnerKind.GROUP.value, owners.c.disabled_at.is_(None))
        )
        with self._db.read() as connection:
            row = connection.execute(query).first()
        return None if row is None else (None if row.role is None else Role(row.role), row.quotas)

    def put_member(self, group: str, user: str, role: Role) -> Member:
        """Add a user to a group, or give the member another role. Raises NotFound: no such group or user."""
        table = schema.members
        where = (table.c.group_id == group, table.c.user_id == user)
        with self._db.write() as connection:
            _found(connection, group, OwnerKind.GROUP)
            name = _found(connection, user, OwnerKind.USER).name
            connection.execute(delete(table).where(*where))
            connection.execute(insert(table).values(group_id=group, user_id=user, role=role.value))
        return Member(user, name, role)

    def remove_member(self, group: str, user: str) -> None:
        """Raises NotFound: the user is no member."""
        table = schema.members
        with self._db.write() as connection:
            where = (table.c.group_id == group, table.c.user_id == user)
            if not connection.execute(delete(table).where(*where)).rowcount:
                raise NotFound("The group has no such member.", field="user_id", value=user, remedy="List the members.")

    # -- property

    def transfer(self, source: str, target: str) -> dict[str, int]:
        """Move all jobs, projects and assets of `source` to `target`; returns numbers by table. `source` may be ""
        (made without a key) or "admin" (with the fixed admin key). Quotas are not checked. Raises NotFound."""
        with self._db.write() as connection:
            if source not in ("", "admin"):
                _found(connection, source)
            _found(connection, target)
            moved = {name: _move(connection, name, source, target) for name in _MOVED}
            return {**moved, "assets": _move_assets(connection, source, target)}


def _move(connection: Connection, name: str, source: str, target: str) -> int:
    table = schema.metadata.tables[name]
    values: Values = {"owner": target}
    if name == "jobs":
        values["idempotency_key"] = None  # it is unique by owner only
    return connection.execute(update(table).where(table.c.owner == source).values(values)).rowcount


def _move_assets(connection: Connection, source: str, target: str) -> int:
    table = schema.asset_owners
    has = select(table.c.asset_id).where(table.c.owner == target)
    moving = (table.c.owner == source, table.c.asset_id.not_in(has))
    moved = connection.execute(update(table).where(*moving).values(owner=target)).rowcount
    return moved + connection.execute(delete(table).where(table.c.owner == source)).rowcount


def add_owner(
    connection: Connection, name: str, kind: OwnerKind, quotas: Mapping[str, int], now: float,
    subject: str | None = None,
) -> Owner:  # fmt: skip
    """Insert an owner. Raises BadParameter."""
    check_name(name)
    owner = Owner(new_id(_PREFIXES[kind]), kind, name, checked_quotas(quotas), now, None, subject)
    connection.execute(insert(schema.owners).values({**vars(owner), "kind": kind.value}))
    return owner


def owner_of(row: Row) -> Owner:
    return Owner(**{name: row[name] for name in Owner.__dataclass_fields__} | {"kind": OwnerKind(row["kind"])})


def _found(connection: Connection, owner_id: str, kind: OwnerKind | None = None) -> Owner:
    row = connection.execute(select(schema.owners).where(schema.owners.c.id == owner_id)).mappings().first()
    if row is None or (kind is not None and row["kind"] != kind.value):
        what, remedy = kind or "owner", "`impasto owners list` shows users and groups."
        raise NotFound(f"There is no {what} {owner_id!r}.", field=what, value=owner_id, remedy=remedy)
    return owner_of(row)


def check_name(name: str, what: str = "An owner") -> None:
    """Raise BadParameter unless a name has 1 to 100 characters."""
    if not name or len(name) > 100:
        raise BadParameter(f"{what} has a name of 1 to 100 characters.", field="name", value=name)


def checked_quotas(quotas: Mapping[str, Any]) -> dict[str, int]:
    """The quotas. Raises BadParameter: unknown name, or a negative limit."""
    for name, limit in quotas.items():
        if name not in QUOTAS:
            remedy = f"Use some of: {', '.join(QUOTAS)}."
            raise BadParameter(f"There is no quota {name!r}.", field="quotas", value=name, remedy=remedy)
        if limit < 0:
            raise BadParameter("A quota is not negative.", field=f"quotas.{name}", value=limit)
    return dict(quotas)
