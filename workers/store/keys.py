"""API keys: `impasto_<id>_<secret>`. Only the SHA-256 of the secret part is kept: it has 256 random bits and cannot be
guessed, so a slow hash would add cost and no safety."""

from __future__ import annotations

import hashlib
import hmac
import secrets
from collections.abc import Collection, Mapping
from contextlib import suppress

from sqlalchemy import ColumnElement, Connection, delete, func, insert, select, update

from pipeline.errors import BadParameter, StorageError
from workers.contract.owners import OwnerKind
from workers.contract.record import SCOPES, ApiKey
from workers.errors import Conflict, NotFound
from workers.ids import new_id
from workers.store import schema
from workers.store.base import StorePart
from workers.store.jobs import ACTIVE_JOBS, MOST_COUNTED
from workers.store.owners import add_owner, check_name
from workers.store.records import Row, key_of

_PREFIX = "impasto_"
_NO_HASH = "0" * 64
USED_S = 3600.0
"""The time of a key's last use is written at most this often, seconds."""


class Keys(StorePart):
    """Keys by id. Everything that is created with a key belongs to the key's owner, who may have several keys."""

    def create(
        self,
        name: str,
        scopes: Collection[str],
        quotas: Mapping[str, int] | None = None,
        owner: str | None = None,
        expires_at: float | None = None,
        session: bool = False,
    ) -> tuple[ApiKey, str]:
        """A new key and its secret, which cannot be shown again.

        Args:
            quotas: of a new user.
            owner: id of an existing user, who gets a further key; None: a new user of this name.
            expires_at: when it ends by itself, seconds since the epoch; None: never.
            session: whether it is a browser's, after its user has signed in.

        Raises:
            BadParameter: unknown scope, bad quota or time, or quotas for an existing owner.
            NotFound: there is no such user.
        """
        check_name(name, "A key")
        _check_scopes(scopes)
        if expires_at is not None and expires_at <= self._now():
            raise BadParameter("A key expires in the future.", field="expires_at", value=expires_at)
        if owner is not None and quotas:
            raise BadParameter(
                "Quotas belong to the owner, not to a key.",
                field="quotas",
                value=sorted(quotas),
                remedy="Change those of the owner.",
            )
        with self._db.write() as connection:
            if owner is None:
                owner = add_owner(connection, name, OwnerKind.USER, quotas or {}, self._now()).id
            return self._add(connection, name, scopes, owner, expires_at, session)

    def _add(
        self, connection: Connection, name: str, scopes: Collection[str], owner: str, expires_at: float | None,
        session: bool = False,
    ) -> tuple[ApiKey, str]:  # fmt: skip
        owners, key_id, secret = schema.owners, new_id("key_"), secrets.token_urlsafe(32)
        user = (owners.c.id == owner, owners.c.kind == OwnerKind.USER.value)
        if connection.execute(select(owners.c.id).where(*user)).first() is None:
            remedy = "`impasto owners list` shows the users. A group has members and no keys."
            raise NotFound(f"There is no user {owner}.", field="owner", value=owner, remedy=remedy)
        row = {"id": key_id, "owner": owner, "name": name, "hash": _hash(secret), "scopes": sorted(scopes)}
        times = {"created_at": self._now(), "expires_at": expires_at}
        connection.execute(insert(schema.api_keys).values(**row, quotas={}, session=session, **times))
        return _found(connection, key_id), f"{_PREFIX}{key_id.removeprefix('key_')}_{secret}"

    def rotate(self, key_id: str) -> tuple[ApiKey, str]:
        """Replace a key: a new one with its owner, name, scopes and expiry, and the old one is revoked, in one
        transaction.

        Raises:
            NotFound: there is no such key.
            Conflict: it is revoked or has expired.
        """
        with self._db.write() as connection:
            old = _found(connection, key_id)
            if old.revoked_at is not None or (old.expires_at is not None and old.expires_at <= self._now()):
                remedy = f"Create a further key for its owner: `impasto keys create NAME --owner {old.owner}`."
                raise Conflict("The key is revoked or has expired.", field="key", value=key_id, remedy=remedy)
            self._revoke(connection, key_id)
            return self._add(connection, old.name, old.scopes, old.owner, old.expires_at)

    def list(self, owner: str | None = None) -> list[ApiKey]:
        """All keys (of an owner), oldest first, revoked ones included; browsers' sessions while they last."""
        keys = schema.api_keys.c
        ended = keys.revoked_at.is_not(None) | (keys.expires_at <= self._now())
        where: list[ColumnElement[bool]] = [~(keys.session & ended)]
        where += [] if owner is None else [keys.owner == owner]
        with self._db.read() as connection:
            rows = connection.execute(_KEYS.where(*where).order_by(keys.id)).mappings().all()
        return [key_of(row) for row in rows]

    def get(self, key_id: str) -> ApiKey:
        """Raises NotFound."""
        with self._db.read() as connection:
            return _found(connection, key_id)

    def is_valid(self, key_id: str) -> bool:
        """Whether `verify` would accept the key's secret."""
        with self._db.read() as connection:
            row = connection.execute(_KEYS.where(schema.api_keys.c.id == key_id)).mappings().first()
        return row is not None and self._is_live(row)

    def _is_live(self, row: Row) -> bool:
        over = row["expires_at"] is not None and row["expires_at"] <= self._now()
        return row["revoked_at"] is None and row["disabled_at"] is None and not over

    def revoke(self, key_id: str) -> ApiKey:
        """Make `verify` refuse the key from now on. Idempotent. Raises NotFound."""
        with self._db.write() as connection:
            return self._revoke(connection, key_id)

    def forget_sessions(self) -> int:
        """Delete the sessions that have expired; returns their number."""
        keys = schema.api_keys
        with self._db.write() as connection:
            gone = delete(keys).where(keys.c.session, keys.c.expires_at <= self._now())
            return connection.execute(gone).rowcount

    def _revoke(self, connection: Connection, key_id: str) -> ApiKey:
        table = schema.api_keys
        live = (table.c.id == key_id, table.c.revoked_at.is_(None))
        connection.execute(update(table).where(*live).values(revoked_at=self._now()))
        return _found(connection, key_id)

    def verify(self, secret: str) -> ApiKey | None:
        """The key of a secret; None: malformed, unknown, revoked, expired, or its owner is disabled. Takes equally long
        for valid and invalid secrets. Notes the time of a valid key's use."""
        named, _, tail = secret.removeprefix(_PREFIX).partition("_")
        key_id = named if named.isascii() and named.isalnum() else "none"
        with self._db.read() as connection:
            row = connection.execute(_KEYS.where(schema.api_keys.c.id == f"key_{key_id}")).mappings().first()
        kept = _NO_HASH if row is None else row["hash"]
        same = hmac.compare_digest(_hash(tail), kept)
        if row is None or not same or not secret.startswith(_PREFIX) or not self._is_live(row):
            return None
        key, now = key_of(row), self._now()
        if key.used_at is None or not 0.0 <= now - key.used_at < USED_S:
            self._note_use(key.id, now)
        return key

    def _note_use(self, key_id: str, now: float) -> None:
        keys = schema.api_keys
        with suppress(StorageError), self._db.write() as connection:  # on a full disk, keys go on to be valid
            connection.execute(update(keys).where(keys.c.id == key_id).values(used_at=now))

    def usage(self, owner: str) -> dict[str, int]:
        """The owner's current use of quotas: "active_jobs" and "asset_bytes"."""
        assets, owners = schema.assets, schema.asset_owners
        stored = (
            select(func.coalesce(func.sum(assets.c.size_bytes), 0))
            .join(owners, owners.c.asset_id == assets.c.id)
            .where(owners.c.owner == owner)
        )
        counted = {"owner": owner, "most": MOST_COUNTED}
        with self._db.read() as connection:
            return {
                "active_jobs": int(connection.execute(ACTIVE_JOBS, counted).scalar_one()),
                "asset_bytes": int(connection.execute(stored).scalar_one()),
            }


_KEYS = select(schema.api_keys, schema.owners.c.quotas.label("owner_quotas"), schema.owners.c.disabled_at).outerjoin(
    schema.owners, schema.owners.c.id == schema.api_keys.c.owner
)


def _found(connection: Connection, key_id: str) -> ApiKey:
    row = connection.execute(_KEYS.where(schema.api_keys.c.id == key_id)).mappings().first()
    if row is None:
        raise NotFound(f"There is no key {key_id}.", field="key", value=key_id, remedy="See `impasto keys list`.")
    return key_of(row)


def _hash(secret: str) -> str:
    return hashlib.sha256(secret.encode("utf-8", "surrogatepass")).hexdigest()


def _check_scopes(scopes: Collection[str]) -> None:
    for scope in scopes:
        if scope not in SCOPES:
            remedy = f"Use some of: {', '.join(SCOPES)}."
            raise BadParameter(f"There is no scope {scope!r}.", field="scopes", value=scope, remedy=remedy)
    if not scopes:
        raise BadParameter("A key has at least one scope.", field="scopes", remedy=f"Use some of: {', '.join(SCOPES)}.")
