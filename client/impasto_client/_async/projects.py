"""The client's part for projects: `Client.projects`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from impasto_client._async import transfer
from impasto_client._async.http import AsyncConnection, given
from impasto_client.files import Progress, existing, quiet
from impasto_client.models import Project, ProjectJob, ProjectVersion, VersionOfProject

MERGE = "application/merge-patch+json"
PATCH = "application/json-patch+json"


class AsyncProjects:
    """Calls of /v1/projects (docs/projects.md). A change names the version that it is made from: another user's change
    in between raises ImpastoError with the code `version-mismatch`."""

    def __init__(self, connection: AsyncConnection) -> None:
        self._at = connection

    async def mine(self, deleted: bool = False) -> list[Project]:
        """Yours, the most recently changed first, without their documents; `deleted`: those that can be restored."""
        return [item async for item in self._at.every("/projects", deleted=deleted or None)]

    async def create(self, name: str = "Untitled", document: Mapping[str, Any] | None = None) -> Project:
        body = {"name": name} if document is None else {"document": dict(document)}
        found: Project = await self._at.json("POST", "/projects", json=body)
        return found

    async def get(self, project_id: str) -> Project:
        """The project with its document and version."""
        found: Project = await self._at.json("GET", f"/projects/{project_id}")
        return found

    async def save(self, project_id: str, document: Mapping[str, Any], version: int) -> Project:
        """Save a whole document made from `version`."""
        headers = {"If-Match": f'"{version}"'}
        found: Project = await self._at.json("PUT", f"/projects/{project_id}", json=dict(document), headers=headers)
        return found

    async def change(
        self, project_id: str, change: Mapping[str, Any] | Sequence[Mapping[str, Any]], version: int
    ) -> Project:
        """Apply a JSON Merge Patch (a mapping) or a JSON Patch (a list of operations) to `version`."""
        kind, body = (MERGE, dict(change)) if isinstance(change, Mapping) else (PATCH, [dict(each) for each in change])
        headers = {"If-Match": f'"{version}"', "Content-Type": kind}
        found: Project = await self._at.json("PATCH", f"/projects/{project_id}", json=body, headers=headers)
        return found

    async def check(self, project_id: str) -> list[dict[str, Any]]:
        """Faults of the document that prevent a render: each has a message, a remedy and a path in the document."""
        found: list[dict[str, Any]] = (await self._at.json("GET", f"/projects/{project_id}/check"))["errors"]
        return found

    async def submit(
        self,
        project_id: str,
        shots: Sequence[str] | None = None,
        *,
        variants: Sequence[str] | None = None,
        frames: tuple[int, int] | None = None,
        output: Mapping[str, Any] | None = None,
        priority: int | None = None,
    ) -> list[ProjectJob]:
        """Submit a job for each shot (None: all), or for each of `variants`. `frames`: paint [first, end) only."""
        body = given(shots=shots, variants=variants, range=frames, output=output, priority=priority)
        found: list[ProjectJob] = (await self._at.json("POST", f"/projects/{project_id}/jobs", json=body))["items"]
        return found

    async def jobs(self, project_id: str) -> list[ProjectJob]:
        """Jobs of the project, newest first."""
        return [item async for item in self._at.every(f"/projects/{project_id}/jobs")]

    async def versions(self, project_id: str) -> list[ProjectVersion]:
        """Stored versions of the project, newest first."""
        return [item async for item in self._at.every(f"/projects/{project_id}/versions")]

    async def version(self, project_id: str, version: int) -> VersionOfProject:
        """One version with its document."""
        found: VersionOfProject = await self._at.json("GET", f"/projects/{project_id}/versions/{version}")
        return found

    async def delete(self, project_id: str) -> None:
        """Delete it; `restore` takes that back within 30 days."""
        await self._at.send("DELETE", f"/projects/{project_id}")

    async def restore(self, project_id: str) -> Project:
        found: Project = await self._at.json("POST", f"/projects/{project_id}/restore")
        return found

    async def download(self, project_id: str, path: str | Path, progress: Progress = quiet) -> Path:
        """One zip with everything that it needs, which `upload` reads."""
        target = Path(path)
        await transfer.download(self._at.http, f"/projects/{project_id}/export", target, progress)
        return target

    async def upload(self, path: str | Path) -> Project:
        """A new project from a zip of `download`."""
        headers = {"Content-Type": "application/zip"}
        content = existing(path).read_bytes()
        found: Project = await self._at.json("POST", "/projects/import", content=content, headers=headers)
        return found
