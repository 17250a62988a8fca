"""/v1/keys: API keys, managed with an admin key."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from fastapi import Path
from pydantic import BaseModel, ConfigDict, Field

from service.access.keys import Scope
from service.context.depends import Admin, Context
from service.routing import Router
from service.schemas import ID, Listing
from workers.contract.record import ApiKey

router = Router(prefix="/v1/keys", tags=["ops"])

Quota = Annotated[int, Field(ge=0, le=2**53)]


class QuotasIn(BaseModel):
    """Limits that differ from the service's defaults."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    active_jobs: Quota | None = None
    asset_bytes: Quota | None = None
    document_bytes: Quota | None = None
    live_sessions: Annotated[int, Field(ge=0, le=10**4)] | None = None
    requests_per_minute: Annotated[int, Field(ge=1, le=10**6)] | None = None
    running_tasks: Annotated[int, Field(ge=1, le=10**6)] | None = None


class KeyIn(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)

    name: str = Field(min_length=1, max_length=100)
    scopes: frozenset[Scope] = Field(min_length=1)
    quotas: QuotasIn = QuotasIn()
    owner: str | None = Field(
        default=None, pattern=ID, description="An existing owner, who gets a further key. None: a new owner."
    )


@dataclass(frozen=True)
class NewKeyOut:
    key: ApiKey
    secret: str
    """The bearer token. Shown only once."""


@router.post("", status_code=201)
def create_key(body: KeyIn, context: Context, _caller: Admin) -> NewKeyOut:
    """Create a key, of a new owner or a further one of an existing owner. Its holder sees only what belongs to its
    owner, unless it has the scope "admin"."""
    quotas = body.quotas.model_dump(exclude_none=True)
    scopes = [scope.value for scope in body.scopes]
    return NewKeyOut(*context.farm.keys.create(body.name, scopes, quotas, body.owner))


@router.get("")
def list_keys(context: Context, _caller: Admin) -> Listing[ApiKey]:
    """All keys, revoked ones included, without their secrets."""
    return Listing(tuple(context.farm.keys.list()), None)


@router.post("/{key_id}/rotate", status_code=201)
def rotate_key(key_id: Annotated[str, Path(pattern=ID)], context: Context, _caller: Admin) -> NewKeyOut:
    """Replace a key: a new one with the same owner, name and scopes; the old one is revoked at once. To let both be
    valid for a while, create a further key of the owner, and revoke the old one later."""
    return NewKeyOut(*context.farm.keys.rotate(key_id))


@router.delete("/{key_id}")
def revoke_key(key_id: Annotated[str, Path(pattern=ID)], context: Context, _caller: Admin) -> ApiKey:
    """Revoke a key at once, and the shared links that were made with it. What belongs to its owner stays."""
    return context.farm.keys.revoke(key_id)
