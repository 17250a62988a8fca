"""Callers and their scopes. The keys are stored by the farm (`farm.keys`)."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

from workers.contract.record import ANY_OWNER, AnyOwner


class Scope(StrEnum):
    READ = "read"
    SUBMIT = "submit"
    ADMIN = "admin"
    """All operations on the data of all owners."""


@dataclass(frozen=True)
class Principal:
    """A caller: the holder of a key, somebody who has signed in, or anyone where no key is required."""

    owner: str
    """Owner of what the caller creates and sees: the user, or the group under whose address the request came; ""
    without a key."""
    scopes: frozenset[str]
    quotas: dict[str, int] = field(default_factory=dict)
    """The owner's limits, by name: "active_jobs", "asset_bytes", "document_bytes", "live_sessions",
    "requests_per_minute", "running_tasks"."""
    key: str = ""
    """Id of the caller's key; "" without a stored key."""
    user: str = ""
    """The user, also where the request is for a group; "" without a key."""
    session: bool = False
    """Whether the user has signed in with a browser."""

    def may(self, scope: Scope) -> bool:
        return scope in self.scopes or Scope.ADMIN in self.scopes

    def sees(self, owner: str) -> bool:
        """Whether the caller may see `owner`'s jobs and assets."""
        return Scope.ADMIN in self.scopes or owner == self.owner

    @property
    def only_owner(self) -> str | None:
        """The only owner whose entries a listing shows; None: all owners."""
        return None if Scope.ADMIN in self.scopes else self.owner

    @property
    def reach(self) -> str | AnyOwner:
        """The owner through whose entries the caller reaches assets; an operator reaches those of all owners."""
        return ANY_OWNER if Scope.ADMIN in self.scopes else self.owner


LIVE_SESSIONS = "live_sessions"
"""Quota of an owner: maximum number of its live sessions."""
EVERYONE = Principal("", frozenset(Scope))
"""A caller without a key, where none is required."""
OPERATOR = Principal("admin", frozenset(Scope), user="admin")
"""The holder of `Settings.admin_key`."""
