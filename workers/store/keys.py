"""API keys: `impasto_<id>_<secret>`. Only the SHA-256 of the secret part is kept: it has 256 random bits and cannot be
guessed, so a slow hash would add cost and no safety."""

from __future__ import annotations

import hashlib
import hmac
import secrets
from collections.abc import Collection, Mapping

from sqlalchemy import Connection, func, insert, select, update

from pipeline.errors import BadParameter
from workers.contract.record import SCOPES, ApiKey
from workers.errors import Conflict, NotFound
from workers.ids import new_id
from workers.store import schema
from workers.store.base import StorePart
from workers.store.jobs import ACTIVE_JOBS, MOST_COUNTED
from workers.store.records import key_of

_PREFIX = "impasto_"
_NO_HASH = "0" * 64


class Keys(StorePart):
    """Keys by id. Everything that is created with a key belongs to the key's owner, who may have several keys."""

    def create(
        self,
        name: str,
        scopes: Collection[str],
        quotas: Mapping[str, int] | None = None,
        owner: str | None = None,
    ) -> tuple[ApiKey, str]:
        """A new key and its secret, which cannot be shown again.

        Args:
            quotas: of a new owner.
            owner: id of an existing owner, who gets a further key; None: a new owner, with the id of this key.

        Raises:
            BadParameter: unknown scope, bad quota, or quotas for an existing owner.
            NotFound: there is no such owner.
        """
        _check(name, scopes, quotas or {})
        if owner is not None and quotas:
            raise BadParameter(
                "Quotas belong to the owner, not to a key.",
                field="quotas",
                value=sorted(quotas),
                remedy="Leave them out.",
            )
        with self._db.write() as connection:
            return self._add(connection, name, scopes, dict(quotas or {}), owner)

    def _add(
        self, connection: Connection, name: str, scopes: Collection[str], quotas: dict[str, int], owner: str | None
    ) -> tuple[ApiKey, str]:
        owners, now, key_id, secret = schema.owners, self._now(), new_id("key_"), secrets.token_urlsafe(32)
        if owner is None:
            new = {"id": key_id, "name": name, "quotas": quotas, "created_at": now}
            connection.execute(insert(owners).values(new))
        else:
            found = connection.execute(select(owners.c.quotas).where(owners.c.id == owner)).first()
            if found is None:
                remedy = "Name the owner of an existing key: `impasto keys list` shows it."
                raise NotFound(f"There is no owner {owner}.", field="owner", value=owner, remedy=remedy)
            quotas = found.quotas
        key = ApiKey(key_id, owner or key_id, name, frozenset(scopes), quotas, now)
        row = {"id": key.id, "owner": key.owner, "name": name, "hash": _hash(secret), "scopes": sorted(scopes)}
        connection.execute(insert(schema.api_keys).values(**row, quotas=quotas, created_at=now))
        return key, f"{_PREFIX}{key.id.removeprefix('key_')}_{secret}"

    def rotate(self, key_id: str) -> tuple[ApiKey, str]:
        """Replace a key: a new one with its owner, name and scopes, and the old one is revoked, in one transaction.

        Raises:
            NotFound: there is no such key.
            Conflict: it is revoked.
        """
        with self._db.write() as connection:
            old = _found(connection, key_id)
            if old.revoked_at is not None:
                remedy = f"Create a further key for its owner: `impasto keys create NAME --owner {old.owner}`."
                raise Conflict("The key is revoked.", field="key", value=key_id, remedy=remedy)
            self._revoke(connection, key_id)
            return self._add(connection, old.name, old.scopes, {}, old.owner)

    def list(self) -> list[ApiKey]:
        """All keys, oldest first, revoked ones included."""
        with self._db.read() as connection:
            rows = connection.execute(_KEYS.order_by(schema.api_keys.c.id)).mappings().all()
        return [key_of(row) for row in rows]

    def get(self, key_id: str) -> ApiKey:
        """Raises NotFound."""
        with self._db.read() as connection:
            return _found(connection, key_id)

    def revoke(self, key_id: str) -> ApiKey:
        """Make `verify` refuse the key from now on. Idempotent. Raises NotFound."""
        with self._db.write() as connection:
            return self._revoke(connection, key_id)

    def _revoke(self, connection: Connection, key_id: str) -> ApiKey:
        table = schema.api_keys
        live = (table.c.id == key_id, table.c.revoked_at.is_(None))
        connection.execute(update(table).where(*live).values(revoked_at=self._now()))
        return _found(connection, key_id)

    def verify(self, secret: str) -> ApiKey | None:
        """The key of a secret; None: malformed, unknown or revoked. Takes equally long for valid and invalid
        secrets."""
        named, _, tail = secret.removeprefix(_PREFIX).partition("_")
        key_id = named if named.isascii() and named.isalnum() else "none"
        with self._db.read() as connection:
            row = connection.execute(_KEYS.where(schema.api_keys.c.id == f"key_{key_id}")).mappings().first()
        kept = _NO_HASH if row is None else row["hash"]
        same = hmac.compare_digest(_hash(tail), kept)
        right = same and secret.startswith(_PREFIX) and row is not None and row["revoked_at"] is None
        return key_of(row) if right and row is not None else None

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


_KEYS = select(schema.api_keys, schema.owners.c.quotas.label("owner_quotas")).outerjoin(
    schema.owners, schema.owners.c.id == schema.api_keys.c.owner
)


def _found(connection: Connection, key_id: str) -> ApiKey:
    row = connection.execute(_KEYS.where(schema.api_keys.c.id == key_id)).mappings().first()
    if row is None:
        raise NotFound(f"There is no key {key_id}.", field="key", value=key_id, remedy="See `impasto keys list`.")
    return key_of(row)


def _hash(secret: str) -> str:
    return hashlib.sha256(secret.encode("utf-8", "surrogatepass")).hexdigest()


def _check(name: str, scopes: Collection[str], quotas: Mapping[str, int]) -> None:
    if not name or len(name) > 100:
        raise BadParameter("A key has a name of 1 to 100 characters.", field="name", value=name)
    for scope in scopes:
        if scope not in SCOPES:
            remedy = f"Use some of: {', '.join(SCOPES)}."
            raise BadParameter(f"There is no scope {scope!r}.", field="scopes", value=scope, remedy=remedy)
    if not scopes:
        raise BadParameter("A key has at least one scope.", field="scopes", remedy=f"Use some of: {', '.join(SCOPES)}.")
    for quota, bound in quotas.items():
        if bound < 0:
            raise BadParameter("A quota is not negative.", field=f"quotas.{quota}", value=bound)
