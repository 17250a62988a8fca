"""/v1/keys: API keys, managed by operators, and by users who have signed in: their own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from fastapi import Depends, Path, Request
from pydantic import BaseModel, ConfigDict, Field

from service.access.audit import about
from service.access.keys import Principal, Scope
from service.context.depends import Anyone, Context, ServiceContext
from service.errors import Forbidden
from service.routing import Router
from service.schemas import ID, Listing
from workers.contract.record import ApiKey
from workers.errors import NotFound

router = Router(prefix="/v1/keys", tags=["ops"])

Quota = Annotated[int, Field(ge=0, le=2**53)]


class QuotasIn(BaseModel):
    """Limits that differ from the service's defaults; null: the default."""

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
        default=None,
        pattern=ID,
        description="An existing user, who gets a further key. None: a new user of this name; of a caller who is no "
        "operator: the caller.",
    )
    expires_at: float | None = Field(
        default=None, gt=0, lt=1e11, description="When the key ends by itself, seconds since the epoch. None: never."
    )


@dataclass(frozen=True)
class NewKeyOut:
    key: ApiKey
    secret: str
    """The bearer token. Shown only once."""


async def _manager(caller: Anyone) -> Principal:
    if not (caller.session or caller.may(Scope.ADMIN)):
        raise Forbidden(
            "A key manages no keys.",
            field="Authorization",
            value=", ".join(sorted(caller.scopes)),
            remedy="Sign in with a browser, or use a key with the scope 'admin'.",
        )
    return caller


Manager = Annotated[Principal, Depends(_manager)]
"""An operator, or a user who has signed in, who manages the own keys only. A key that could make others would outlive
its revocation."""


def _own(context: ServiceContext, caller: Principal, key_id: str) -> None:
    """Raise NotFound unless the caller may manage the key."""
    if not caller.may(Scope.ADMIN) and context.farm.keys.get(key_id).owner != caller.user:
        raise NotFound(f"There is no key {key_id}.", field="key", value=key_id, remedy="See GET /v1/keys for yours.")


@router.post("", status_code=201)
def create_key(body: KeyIn, request: Request, context: Context, caller: Manager) -> NewKeyOut:
    """Create a key, of a new user or a further one of an existing user. Its holder sees only what belongs to the user
    and the user's groups, unless it has the scope "admin". Users who have signed in create keys of their own, with at
    most the scopes that they have."""
    quotas, owner = body.quotas.model_dump(exclude_none=True), body.owner
    if not caller.may(Scope.ADMIN):
        owner = owner or caller.user
        if quotas or owner != caller.user or not body.scopes <= caller.scopes:
            raise Forbidden(
                "You create keys for yourself, with scopes that you have, and without quotas.", field="scopes",
                value=", ".join(sorted(body.scopes)), remedy=f"Use some of: {', '.join(sorted(caller.scopes))}.",
            )  # fmt: skip
    scopes = [scope.value for scope in body.scopes]
    made = NewKeyOut(*context.farm.keys.create(body.name, scopes, quotas, owner, body.expires_at))
    about(request, made.key.id, made.key.owner)
    return made


@router.get("")
def list_keys(context: Context, caller: Manager) -> Listing[ApiKey]:
    """All keys, revoked ones included, without their secrets; of users who have signed in: their own, and the sessions
    of their browsers."""
    return Listing(tuple(context.farm.keys.list(None if caller.may(Scope.ADMIN) else caller.user)), None)


@router.post("/{key_id}/rotate", status_code=201)
def rotate_key(
    key_id: Annotated[str, Path(pattern=ID)], request: Request, context: Context, caller: Manager
) -> NewKeyOut:
    """Replace a key: a new one with the same owner, name, scopes and expiry; the old one is revoked at once. To let
    both be valid for a while, create a further key of the owner, and revoke the old one later."""
    _own(context, caller, key_id)
    made = NewKeyOut(*context.farm.keys.rotate(key_id))
    about(request, made.key.id)
    return made


@router.delete("/{key_id}")
def revoke_key(key_id: Annotated[str, Path(pattern=ID)], context: Context, caller: Manager) -> ApiKey:
    """Revoke a key at once, and the shared links that were made with it. What belongs to its owner stays."""
    _own(context, caller, key_id)
    return context.farm.keys.revoke(key_id)
