"""Who is asking, and what they may do. The keys themselves are the farm's (`farm.keys`)."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum


class Scope(StrEnum):
    READ = "read"
    SUBMIT = "submit"
    ADMIN = "admin"
    """Everything, of everyone."""


@dataclass(frozen=True)
class Principal:
    """The holder of a key, or whoever is let in without one."""

    owner: str
    """The key's id: the owner of what is made with it. "" when no key was needed."""
    scopes: frozenset[str]
    quotas: dict[str, int] = field(default_factory=dict)
    """The key's own bounds, by name: "active_jobs", "asset_bytes", "requests_per_minute", "running_tasks"."""

    def may(self, scope: Scope) -> bool:
        return scope in self.scopes or Scope.ADMIN in self.scopes

    def sees(self, owner: str) -> bool:
        """Whether things of `owner` exist for this one."""
        return Scope.ADMIN in self.scopes or owner == self.owner

    @property
    def only_owner(self) -> str | None:
        """For listings: the one owner whose things may be seen, None for all."""
        return None if Scope.ADMIN in self.scopes else self.owner


EVERYONE = Principal("", frozenset(Scope))
"""Without a key where none is needed."""
OPERATOR = Principal("admin", frozenset(Scope))
"""The holder of `Settings.admin_key`."""
