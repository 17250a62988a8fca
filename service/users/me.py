"""/v1/me: who the caller is. /v1/groups: the members of a group, chosen by its owners and by operators."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from fastapi import Path
from pydantic import BaseModel, ConfigDict

from service.access.keys import Principal, Scope
from service.context.depends import Anyone, Context, Reader, ServiceContext, Submitter
from service.errors import Forbidden
from service.routing import Router
from service.schemas import ID, Listing
from workers.contract.owners import Member, Membership, Role
from workers.errors import NotFound

router = Router(prefix="/v1", tags=["users"])

GroupId = Annotated[str, Path(pattern=ID, description="A group's id (`grp_...`).")]
UserId = Annotated[str, Path(pattern=ID, description="A user's id (`usr_...`), as `GET /v1/me` tells its user.")]


@dataclass(frozen=True)
class MeOut:
    """The caller."""

    user: str
    """Id; "admin" with the fixed admin key, "" without a key."""
    name: str
    owner: str
    """Who owns what the caller makes: the user, or the group under whose address (`/groups/grp_.../`) the request
    was."""
    scopes: tuple[str, ...]
    session: bool
    """Whether the caller has signed in with a browser, and may manage the own keys."""
    quotas: dict[str, int]
    """The owner's limits that differ from the service's."""
    usage: dict[str, int]
    """The owner's unfinished jobs ("active_jobs") and bytes of assets ("asset_bytes")."""
    groups: tuple[Membership, ...]
    """Groups of the user. Everything under the address `/groups/{group}/` is done for that group, pages included."""


class MemberIn(BaseModel):
    """The role of a member."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    role: Role


@router.get("/me")
def get_me(context: Context, caller: Anyone) -> MeOut:
    """The caller: user, scopes, groups, quotas and their use."""
    farm = context.farm
    try:
        name = farm.owners.get(caller.user).name
    except NotFound:
        name = caller.user
    return MeOut(
        caller.user, name, caller.owner, tuple(sorted(caller.scopes)), caller.session, caller.quotas,
        farm.keys.usage(caller.owner), tuple(farm.owners.memberships(caller.user)),
    )  # fmt: skip


@router.get("/groups/{group_id}/members")
def list_members(group_id: GroupId, context: Context, caller: Reader) -> Listing[Member]:
    """The members of a group, for its members."""
    _role(context, caller, group_id)
    return Listing(tuple(context.farm.owners.members(group_id)), None)


@router.put("/groups/{group_id}/members/{user_id}")
def put_member(group_id: GroupId, user_id: UserId, body: MemberIn, context: Context, caller: Submitter) -> Member:
    """Add a user to a group, or change the role. Needs the role owner in the group, or the scope admin."""
    _need_owner(context, caller, group_id)
    return context.farm.owners.put_member(group_id, user_id, body.role)


@router.delete("/groups/{group_id}/members/{user_id}", status_code=204)
def remove_member(group_id: GroupId, user_id: UserId, context: Context, caller: Submitter) -> None:
    """Remove a user from a group; what the user made there stays the group's. Every member may leave."""
    if user_id == caller.user:
        _role(context, caller, group_id)
    else:
        _need_owner(context, caller, group_id)
    context.farm.owners.remove_member(group_id, user_id)


def _role(context: ServiceContext, caller: Principal, group_id: str) -> Role:
    """The caller's role in the group. Raises NotFound for strangers, as if there were no such group."""
    found = context.farm.owners.role(caller.user, group_id)
    role = Role.OWNER if caller.may(Scope.ADMIN) else found and found[0]
    if found is None or role is None:
        raise NotFound("Group not found.", field="group_id", value=group_id, remedy="GET /v1/me lists your groups.")
    return role


def _need_owner(context: ServiceContext, caller: Principal, group_id: str) -> None:
    if (role := _role(context, caller, group_id)) is not Role.OWNER:
        raise Forbidden(
            "Only owners of a group choose its members.", field="role", value=role, remedy="Ask an owner of the group."
        )
