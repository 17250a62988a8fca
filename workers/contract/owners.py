"""Owners of assets, jobs and projects: users, and groups of users. What operators see of them."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class OwnerKind(StrEnum):
    USER = "user"
    GROUP = "group"


class Role(StrEnum):
    """What a member may do with what belongs to the group."""

    OWNER = "owner"
    """Everything that an editor may, and choose the members."""
    EDITOR = "editor"
    VIEWER = "viewer"

    @property
    def scopes(self) -> frozenset[str]:
        """The scopes of keys that the role gives."""
        return frozenset({"read"} if self is Role.VIEWER else {"read", "submit"})


@dataclass(frozen=True)
class Owner:
    """A user or a group."""

    id: str
    """`usr_...` or `grp_...`; owners of earlier versions have the id of their first key."""
    kind: OwnerKind
    name: str
    quotas: dict[str, int]
    created_at: float
    disabled_at: float | None = None
    """Since when its keys are refused; None: it is not disabled."""
    subject: str | None = None
    """Who signs in as this user: issuer and subject of an OpenID provider, with a space between."""


@dataclass(frozen=True)
class Membership:
    """A group of a user."""

    group: str
    name: str
    role: Role


@dataclass(frozen=True)
class Member:
    """A user of a group."""

    user: str
    name: str
    role: Role


@dataclass(frozen=True)
class AuditEntry:
    """Who did what. Only actions that succeeded are recorded."""

    action: str
    """Name of the operation, as the OpenAPI document has it (`create_key`); or `sign_in`, `retention`."""
    object: str = ""
    """Ids of what it was done to, with spaces between."""
    user: str = ""
    """Id of the user; "admin": the holder of the fixed admin key; "command:NAME": a user of the service's machine;
    "": somebody without a key, where none is required."""
    key: str = ""
    """Id of the key; "": none."""
    owner: str = ""
    """The user or group for whom it was done."""
    address: str = ""
    """Network address of the client."""
    at: float = 0.0
    id: str = ""
    """`aud_...`"""


@dataclass(frozen=True)
class Cost:
    """Costs of the jobs of one owner, or with one value of a label, that ended in a period."""

    name: str
    """The owner, or the label's value; "": jobs without the label."""
    jobs: int
    cpu_s: float
    """CPU seconds of successful attempts; decoders of uploaded files are not included."""
    busy_s: float
    """Seconds for which successful attempts occupied a slot."""
    bytes: int
    """Stored results: each job's at its end, also if they were deleted since."""


@dataclass(frozen=True)
class RetentionRule:
    """Jobs that ended more than `days` ago are deleted with their results. Rules add up: each deletes what it fits."""

    days: float
    owner: str | None = None
    """Only jobs of this user or group; None: of all."""
    label: str | None = None
    """Only jobs with this label; None: whatever their labels are."""
    value: str | None = None
    """Only jobs whose label has this value; None: any."""
    id: str = ""
    """`rul_...`"""
    created_at: float = 0.0
