"""The client's part for users and groups: `Client.owners`."""

from __future__ import annotations

from typing import Any
from urllib.parse import quote

from impasto_client._async.http import AsyncConnection, given

Json = dict[str, Any]


class AsyncOwners:
    """Users, groups, and what operators know of them. All but `members` and their changes need an admin key."""

    def __init__(self, connection: AsyncConnection) -> None:
        self._at = connection

    async def all(self) -> list[Json]:
        """Users and groups, the oldest first."""
        return await self._at.items("/ops/owners")

    async def create(self, kind: str, name: str, quotas: dict[str, int] | None = None) -> Json:
        """A new "user" without keys, or a new "group" without members."""
        found: Json = await self._at.json(
            "POST", "/ops/owners", json={"kind": kind, "name": name, "quotas": quotas or {}}
        )
        return found

    async def change(self, owner_id: str, **changes: Any) -> Json:
        """Change `name`, `quotas` (name -> limit, None: the service's), `disabled` or `subject`. Raises NotFound."""
        found: Json = await self._at.json("PATCH", f"/ops/owners/{quote(owner_id, safe='')}", json=changes)
        return found

    async def transfer(self, source: str, target: str) -> dict[str, int]:
        """Move all jobs, projects and assets of a user or group to another; numbers by kind. Raises NotFound."""
        path = f"/ops/owners/{quote(source, safe='')}/transfer"
        found: dict[str, int] = (await self._at.json("POST", path, json={"to": target}))["moved"]
        return found

    async def members(self, group_id: str) -> list[Json]:
        """Members of a group with their roles. Raises NotFound."""
        return await self._at.items(f"/groups/{quote(group_id, safe='')}/members")

    async def put_member(self, group_id: str, user_id: str, role: str) -> Json:
        """Add a user to a group, or change the role: "owner", "editor" or "viewer". Raises NotFound, Forbidden."""
        found: Json = await self._at.json("PUT", _member(group_id, user_id), json={"role": role})
        return found

    async def remove_member(self, group_id: str, user_id: str) -> None:
        """Raises NotFound, Forbidden."""
        await self._at.send("DELETE", _member(group_id, user_id))

    async def audit(
        self, who: str | None = None, action: str | None = None, about: str | None = None, limit: int = 50
    ) -> list[Json]:
        """Who changed what, newest first."""
        query = {"who": who, "action": action, "about": about}
        return [item async for item in self._at.every("/ops/audit", most=limit, **query)]

    async def costs(self, by: str = "owner", since: float = 0.0, until: float | None = None) -> list[Json]:
        """Costs of jobs that ended in a period (seconds since the epoch), by "owner" or by the values of a label."""
        return await self._at.items("/ops/costs", by=by, since=since, until=until)

    async def rules(self) -> list[Json]:
        """Rules that delete old jobs, each with what it deletes at the next sweep."""
        return await self._at.items("/ops/retention")

    async def add_rule(
        self, days: float, owner: str | None = None, label: str | None = None, value: str | None = None,
        dry_run: bool = False,
    ) -> Json:  # fmt: skip
        """Delete jobs that ended more than `days` ago, from now on. `dry_run`: only say which."""
        body = given(days=days, owner=owner, label=label, value=value)
        found: Json = await self._at.json("POST", "/ops/retention", json=body, params={"dry_run": dry_run})
        return found

    async def remove_rule(self, rule_id: str) -> None:
        """Raises NotFound."""
        await self._at.send("DELETE", f"/ops/retention/{quote(rule_id, safe='')}")

    async def apply_rules(self) -> list[str]:
        """Delete what the rules fit now; ids of the deleted jobs."""
        found: list[str] = (await self._at.json("POST", "/ops/retention/apply"))["items"]
        return found


def _member(group_id: str, user_id: str) -> str:
    return f"/groups/{quote(group_id, safe='')}/members/{quote(user_id, safe='')}"
