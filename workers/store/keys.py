"""API keys: `impasto_<id>_<secret>`. Only the SHA-256 of the secret part is kept: it has 256 random bits and cannot be
guessed, so a slow hash would add cost and no safety."""

from __future__ import annotations

import hashlib
import hmac
import secrets
from collections.abc import Collection, Mapping

from sqlalchemy import func, insert, select, update

from pipeline.errors import BadParameter
from workers.errors import NotFound
from workers.ids import new_id
from workers.model import SCOPES, ApiKey
from workers.store import schema
from workers.store.base import StorePart
from workers.store.jobs import ACTIVE_JOBS, MOST_COUNTED
from workers.store.records import key_of

_PREFIX = "impasto_"
_NO_HASH = "0" * 64


class Keys(StorePart):
    """Keys by id. A key's id is the owner of everything created with it."""

    def create(self, name: str, scopes: Collection[str], quotas: Mapping[str, int] | None = None) -> tuple[ApiKey, str]:
        """A new key and its secret, which cannot be shown again. Raises BadParameter (unknown scope, bad quota)."""
        _check(name, scopes, quotas or {})
        key = ApiKey(new_id("key_"), name, frozenset(scopes), dict(quotas or {}), self._now())
        secret = secrets.token_urlsafe(32)
        row = {"id": key.id, "name": name, "hash": _hash(secret), "scopes": sorted(scopes), "quotas": key.quotas}
        with self._db.write() as connection:
            connection.execute(insert(schema.api_keys).values(**row, created_at=key.created_at))
        return key, f"{_PREFIX}{key.id.removeprefix('key_')}_{secret}"

    def list(self) -> list[ApiKey]:
        """All keys, oldest first, revoked ones included."""
        with self._db.read() as connection:
            rows = connection.execute(select(schema.api_keys).order_by(schema.api_keys.c.id)).mappings().all()
        return [key_of(row) for row in rows]

    def revoke(self, key_id: str) -> ApiKey:
        """Make `verify` refuse the key from now on. Idempotent. Raises NotFound."""
        table = schema.api_keys
        with self._db.write() as connection:
            live = (table.c.id == key_id, table.c.revoked_at.is_(None))
            connection.execute(update(table).where(*live).values(revoked_at=self._now()))
            row = connection.execute(select(table).where(table.c.id == key_id)).mappings().first()
        if row is None:
            raise NotFound(f"There is no key {key_id}.", field="key", value=key_id)
        return key_of(row)

    def verify(self, secret: str) -> ApiKey | None:
        """The key of a secret; None: malformed, unknown or revoked. Takes equally long for valid and invalid
        secrets."""
        table = schema.api_keys
        named, _, tail = secret.removeprefix(_PREFIX).partition("_")
        key_id = named if named.isascii() and named.isalnum() else "none"
        with self._db.read() as connection:
            row = connection.execute(select(table).where(table.c.id == f"key_{key_id}")).mappings().first()
        kept = _NO_HASH if row is None else row["hash"]
        same = hmac.compare_digest(_hash(tail), kept)
        right = same and secret.startswith(_PREFIX) and row is not None and row["revoked_at"] is None
        return key_of(row) if right and row is not None else None

    def usage(self, key_id: str) -> dict[str, int]:
        """Current use of quotas: "active_jobs" and "asset_bytes"."""
        assets, owners = schema.assets, schema.asset_owners
        stored = (
            select(func.coalesce(func.sum(assets.c.size_bytes), 0))
            .join(owners, owners.c.asset_id == assets.c.id)
            .where(owners.c.owner == key_id)
        )
        with self._db.read() as connection:
            return {
                "active_jobs": int(
                    connection.execute(ACTIVE_JOBS, {"owner": key_id, "most": MOST_COUNTED}).scalar_one()
                ),
                "asset_bytes": int(connection.execute(stored).scalar_one()),
            }


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
