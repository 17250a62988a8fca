"""Made from `_async` by client/make_sync.py: do not edit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from impasto_client._sync import transfer
from impasto_client._sync.http import Connection, given
from impasto_client.files import Progress, existing, quiet
from impasto_client.models import Project, ProjectJob, ProjectVersion, VersionOfProject

MERGE = "application/merge-patch+json"
PATCH = "application/json-patch+json"


class Projects:
    """Calls of /v1/projects (docs/projects.md). A change names the version that it is made from: another user's change
    in between raises ImpastoError with the code `version-mismatch`."""

    def __init__(self, connection: Connection) -> None:
        self._at = connection

    def mine(self, deleted: bool = False) -> list[Project]:
        """Yours, the most recently changed first, without their documents; `deleted`: those that can be restored."""
        return [item for item in self._at.every("/projects", deleted=deleted or None)]

    def create(self, name: str = "Untitled", document: Mapping[str, Any] | None = None) -> Project:
        body = {"name": name} if document is None else {"document": dict(document)}
        found: Project = self._at.json("POST", "/projects", json=body)
        return found

    def get(self, project_id: str) -> Project:
        """The project with its document and version."""
        found: Project = self._at.json("GET", f"/projects/{project_id}")
        return found

    def save(self, project_id: str, document: Mapping[str, Any], version: int) -> Project:
        """Save a whole document made from `version`."""
        headers = {"If-Match": f'"{version}"'}
        found: Project = self._at.json("PUT", f"/projects/{project_id}", json=dict(document), headers=headers)
        return found

    def change(self, project_id: str, change: Mapping[str, Any] | Sequence[Mapping[str, Any]], version: int) -> Project:
        """Apply a JSON Merge Patch (a mapping) or a JSON Patch (a list of operations) to `version`."""
        kind, body = (MERGE, dict(change)) if isinstance(change, Mapping) else (PATCH, [dict(each) for each in change])
        headers = {"If-Match": f'"{version}"', "Content-Type": kind}
        found: Project = self._at.json("PATCH", f"/projects/{project_id}", json=body, headers=headers)
        return found

    def check(self, project_id: str) -> list[dict[str, Any]]:
        """Faults of the document that prevent a render: each has a message, a remedy and a path in the document."""
        found: list[dict[str, Any]] = (self._at.json("GET", f"/projects/{project_id}/check"))["errors"]
        return found

    def submit(
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
        found: list[ProjectJob] = (self._at.json("POST", f"/projects/{project_id}/jobs", json=body))["items"]
        return found

    def jobs(self, project_id: str) -> list[ProjectJob]:
        """Jobs of the project, newest first."""
        return [item for item in self._at.every(f"/projects/{project_id}/jobs")]

    def versions(self, project_id: str) -> list[ProjectVersion]:
        """Stored versions of the project, newest first."""
        return [item for item in self._at.every(f"/projects/{project_id}/versions")]

    def version(self, project_id: str, version: int) -> VersionOfProject:
        """One version with its document."""
        found: VersionOfProject = self._at.json("GET", f"/projects/{project_id}/versions/{version}")
        return found

    def delete(self, project_id: str) -> None:
        """Delete it; `restore` takes that back within 30 days."""
        self._at.send("DELETE", f"/projects/{project_id}")

    def restore(self, project_id: str) -> Project:
        found: Project = self._at.json("POST", f"/projects/{project_id}/restore")
        return found

    def download(self, project_id: str, path: str | Path, progress: Progress = quiet) -> Path:
        """One zip with everything that it needs, which `upload` reads."""
        target = Path(path)
        transfer.download(self._at.http, f"/projects/{project_id}/export", target, progress)
        return target

    def upload(self, path: str | Path) -> Project:
        """A new project from a zip of `download`."""
        headers = {"Content-Type": "application/zip"}
        content = existing(path).read_bytes()
        found: Project = self._at.json("POST", "/projects/import", content=content, headers=headers)
        return found
