"""Made from `_async` by client/make_sync.py: do not edit."""

from __future__ import annotations

from typing import Any
from urllib.parse import quote

from impasto_client._sync.http import Connection, given

Json = dict[str, Any]


class Owners:
    """Users, groups, and what operators know of them. All but `members` and their changes need an admin key."""

    def __init__(self, connection: Connection) -> None:
        self._at = connection

    def all(self) -> list[Json]:
        """Users and groups, the oldest first."""
        return self._at.items("/ops/owners")

    def create(self, kind: str, name: str, quotas: dict[str, int] | None = None) -> Json:
        """A new "user" without keys, or a new "group" without members."""
        found: Json = self._at.json("POST", "/ops/owners", json={"kind": kind, "name": name, "quotas": quotas or {}})
        return found

    def change(self, owner_id: str, **changes: Any) -> Json:
        """Change `name`, `quotas` (name -> limit, None: the service's), `disabled` or `subject`. Raises NotFound."""
        found: Json = self._at.json("PATCH", f"/ops/owners/{quote(owner_id, safe='')}", json=changes)
        return found

    def transfer(self, source: str, target: str) -> dict[str, int]:
        """Move all jobs, projects and assets of a user or group to another; numbers by kind. Raises NotFound."""
        path = f"/ops/owners/{quote(source, safe='')}/transfer"
        found: dict[str, int] = (self._at.json("POST", path, json={"to": target}))["moved"]
        return found

    def members(self, group_id: str) -> list[Json]:
        """Members of a group with their roles. Raises NotFound."""
        return self._at.items(f"/groups/{quote(group_id, safe='')}/members")

    def put_member(self, group_id: str, user_id: str, role: str) -> Json:
        """Add a user to a group, or change the role: "owner", "editor" or "viewer". Raises NotFound, Forbidden."""
        found: Json = self._at.json("PUT", _member(group_id, user_id), json={"role": role})
        return found

    def remove_member(self, group_id: str, user_id: str) -> None:
        """Raises NotFound, Forbidden."""
        self._at.send("DELETE", _member(group_id, user_id))

    def audit(
        self, who: str | None = None, action: str | None = None, about: str | None = None, limit: int = 50
    ) -> list[Json]:
        """Who changed what, newest first."""
        query = {"who": who, "action": action, "about": about}
        return [item for item in self._at.every("/ops/audit", most=limit, **query)]

    def costs(self, by: str = "owner", since: float = 0.0, until: float | None = None) -> list[Json]:
        """Costs of jobs that ended in a period (seconds since the epoch), by "owner" or by the values of a label."""
        return self._at.items("/ops/costs", by=by, since=since, until=until)

    def rules(self) -> list[Json]:
        """Rules that delete old jobs, each with what it deletes at the next sweep."""
        return self._at.items("/ops/retention")

    def add_rule(
        self, days: float, owner: str | None = None, label: str | None = None, value: str | None = None,
        dry_run: bool = False,
    ) -> Json:  # fmt: skip
        """Delete jobs that ended more than `days` ago, from now on. `dry_run`: only say which."""
        body = given(days=days, owner=owner, label=label, value=value)
        found: Json = self._at.json("POST", "/ops/retention", json=body, params={"dry_run": dry_run})
        return found

    def remove_rule(self, rule_id: str) -> None:
        """Raises NotFound."""
        self._at.send("DELETE", f"/ops/retention/{quote(rule_id, safe='')}")

    def apply_rules(self) -> list[str]:
        """Delete what the rules fit now; ids of the deleted jobs."""
        found: list[str] = (self._at.json("POST", "/ops/retention/apply"))["items"]
        return found


def _member(group_id: str, user_id: str) -> str:
    return f"/groups/{quote(group_id, safe='')}/members/{quote(user_id, safe='')}"
