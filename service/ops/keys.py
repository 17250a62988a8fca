"""/v1/keys: API keys, for holders of an admin key."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from fastapi import APIRouter, Path
from pydantic import BaseModel, ConfigDict, Field

from service.access.depends import Admin, Parts
from service.access.keys import Scope
from service.schemas import ID, Listing
from workers.farm import ApiKey

router = APIRouter(prefix="/v1/keys", tags=["ops"])

Quota = Annotated[int, Field(ge=0, le=2**53)]


class QuotasIn(BaseModel):
    """Bounds that differ from the service's own."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    active_jobs: Quota | None = None
    asset_bytes: Quota | None = None
    requests_per_minute: Annotated[int, Field(ge=1, le=10**6)] | None = None
    running_tasks: Annotated[int, Field(ge=1, le=10**6)] | None = None


class KeyIn(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)

    name: str = Field(min_length=1, max_length=100)
    scopes: frozenset[Scope] = Field(min_length=1)
    quotas: QuotasIn = QuotasIn()


@dataclass(frozen=True)
class NewKeyOut:
    key: ApiKey
    secret: str
    """What to send as the bearer token. Shown this once."""


@router.post("", status_code=201)
def create_key(body: KeyIn, parts: Parts, _caller: Admin) -> NewKeyOut:
    """Make a key. Its holder sees only what is made with it, unless it has the scope "admin"."""
    quotas = body.quotas.model_dump(exclude_none=True)
    return NewKeyOut(*parts.farm.keys.create(body.name, [scope.value for scope in body.scopes], quotas))


@router.get("")
def list_keys(parts: Parts, _caller: Admin) -> Listing[ApiKey]:
    """Every key, without its secret, revoked ones too."""
    return Listing(tuple(parts.farm.keys.list()), None)


@router.delete("/{key_id}")
def revoke_key(key_id: Annotated[str, Path(pattern=ID)], parts: Parts, _caller: Admin) -> ApiKey:
    """From now on this key opens nothing. What was made with it stays."""
    return parts.farm.keys.revoke(key_id)
