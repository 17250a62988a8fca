"""/v1/ops/owners: users and groups, their quotas, and the move of everything from one to another."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from fastapi import Path, Request
from pydantic import BaseModel, ConfigDict, Field

from service.access.audit import about
from service.context.depends import Admin, Context
from service.routing import Router
from service.schemas import ID, Listing
from service.users.keys import QuotasIn
from workers.contract.owners import Owner, OwnerKind

router = Router(prefix="/v1/ops/owners", tags=["ops"])

NOBODY = "nobody"
"""Instead of an id: whoever worked while the service required no key."""
OwnerId = Annotated[str, Path(pattern=ID, description="Id of a user (`usr_...`) or group (`grp_...`).")]
Name = Annotated[str, Field(min_length=1, max_length=100)]


class OwnerIn(BaseModel):
    """A new user, who has no key yet, or a new group."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    kind: OwnerKind
    name: Name
    quotas: QuotasIn = QuotasIn()


class OwnerPatch(BaseModel):
    """What is to change; what is left out stays."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: Name | None = None
    quotas: QuotasIn | None = Field(default=None, description="Limits to set; null: the service's default again.")
    disabled: bool | None = Field(
        default=None,
        description="true: the user's keys, or all who ask for the group, are refused. Nothing is deleted.",
    )
    subject: str | None = Field(
        default=None,
        min_length=3,
        max_length=500,
        description="Issuer and subject at the OpenID provider, a space between: who signs in so is this user.",
    )


class TransferIn(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)

    to: str = Field(pattern=ID, description="The new owner of everything.")


@dataclass(frozen=True)
class TransferOut:
    moved: dict[str, int]
    """Numbers of jobs, projects, assets, webhook messages and costs."""


@router.get("")
def list_owners(context: Context, _caller: Admin) -> Listing[Owner]:
    """All users and groups, the oldest first."""
    return Listing(tuple(context.farm.owners.all()), None)


@router.post("", status_code=201)
def create_owner(body: OwnerIn, request: Request, context: Context, _caller: Admin) -> Owner:
    """Create a group, or a user without keys."""
    made = context.farm.owners.add(body.name, body.kind, body.quotas.model_dump(exclude_none=True))
    about(request, made.id)
    return made


@router.patch("/{owner_id}")
def change_owner(owner_id: OwnerId, body: OwnerPatch, context: Context, _caller: Admin) -> Owner:
    """Change the name or quotas of a user or group, disable it, or name who signs in as the user."""
    quotas = None if body.quotas is None else body.quotas.model_dump(exclude_unset=True)
    if body.subject is not None:
        context.farm.owners.link(owner_id, body.subject)
    return context.farm.owners.change(owner_id, body.name, quotas, body.disabled)


@router.post("/{owner_id}/transfer")
def transfer(owner_id: OwnerId, body: TransferIn, request: Request, context: Context, _caller: Admin) -> TransferOut:
    """Move all jobs, projects and assets to another user or group. `admin`: what the fixed admin key has made;
    `nobody`: what was made while no key was required."""
    about(request, body.to)
    return TransferOut(context.farm.owners.transfer("" if owner_id == NOBODY else owner_id, body.to))
