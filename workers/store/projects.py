"""Projects in the database: every version of a document, the assets that versions name, the jobs made of them.

Documents are kept as compressed JSON. A version is written only if it is based on the stored one. `thin` deletes old
versions that `Retention` does not keep.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from sqlalchemy import ColumnElement, Connection, delete, func, insert, select, update

from workers.contract.project import Project, ProjectJob, ProjectVersion, VersionMismatch
from workers.contract.record import Page
from workers.contract.request import Json
from workers.errors import NotFound, QuotaExceeded
from workers.ids import new_id
from workers.store import schema
from workers.store.base import StorePart
from workers.store.records import Row, pack_cursor, unpack_cursor

_LEVEL = 6
_THINNED_AT_ONCE = 20
_ROW_BYTES = 256
"""Bytes that a row of a version or of a named asset counts, without the document."""
MOST_VERSIONS = 500
"""Versions of a project, without those that are named or that jobs were submitted from. If there are more, every second
one of the older half is deleted."""
_COUNTED_EVERY = 50
"""The number of a project's versions is compared with `MOST_VERSIONS` once in so many saves."""


@dataclass(frozen=True)
class Draft:
    """A document to be stored.

    Attributes:
        document: JSON object.
        asset_ids: ids of the assets that the document names.
        author: owner of the key that saves it.
    """

    document: Json
    name: str
    asset_ids: Collection[str]
    author: str

    @cached_property
    def body(self) -> bytes:
        """The document as JSON text."""
        return json.dumps(self.document, ensure_ascii=False, separators=(",", ":")).encode()

    @property
    def size_bytes(self) -> int:
        return len(self.body)

    @cached_property
    def packed(self) -> bytes:
        """The compressed document, as it is stored."""
        return zlib.compress(self.body, _LEVEL)


@dataclass(frozen=True)
class Retention:
    """Rule for the versions that are kept: all younger than `every_s`; of older ones the last of each `then_one_in_s`;
    always the newest, labelled ones, and those from which jobs were submitted."""

    every_s: float = 7 * 86400.0
    then_one_in_s: float = 3600.0


class StoredProjects(StorePart):
    """Projects by id."""

    def create(self, draft: Draft, owner: str, max_bytes: int | None = None) -> Project:
        """A new project with `draft` as version 1.

        Args:
            max_bytes: that the versions of all projects of the owner may take; None: any number.

        Raises:
            QuotaExceeded: they would take more.
        """
        project_id, now = new_id("prj_"), self._now()
        row = {"id": project_id, "owner": owner, "name": draft.name, "version": 1, "created_at": now,
               "updated_at": now, "deleted_at": None, "share_epoch": 0}  # fmt: skip
        with self._db.write() as connection:
            _check_quota(connection, owner, draft, max_bytes)
            connection.execute(insert(schema.projects).values(row))
            _write(connection, project_id, 1, now, draft)
        return _project(row)

    def get(self, project_id: str) -> Project:
        """The project, deleted or not. Raises NotFound."""
        with self._db.read() as connection:
            return _project(_row(connection, project_id))

    def page(self, owner: str | None, deleted: bool, cursor: str | None, limit: int) -> Page:
        """Projects, the most recently changed first."""
        table = schema.projects
        gone = table.c.deleted_at.is_not(None)
        where: list[ColumnElement[bool]] = [gone if deleted else ~gone]
        if owner is not None:
            where.append(table.c.owner == owner)
        if cursor is not None:
            at, last = unpack_cursor(cursor, float, str)
            where.append((table.c.updated_at < at) | ((table.c.updated_at == at) & (table.c.id < last)))
        order = (table.c.updated_at.desc(), table.c.id.desc())
        with self._db.read() as connection:
            rows = connection.execute(select(table).where(*where).order_by(*order).limit(limit + 1)).mappings().all()
        items = tuple(_project(row) for row in rows[:limit])
        return Page(items, pack_cursor(items[-1].updated_at, items[-1].id) if len(rows) > limit else None)

    def document(self, project_id: str, version: int | None = None) -> tuple[ProjectVersion, Json]:
        """A version and its document; None: the newest. Raises NotFound (unknown, or thinned out)."""
        table = schema.project_versions
        with self._db.read() as connection:
            wanted = version or _row(connection, project_id)["version"]
            query = select(table).where(table.c.project_id == project_id, table.c.version == wanted)
            row = connection.execute(query).mappings().first()
            if row is None:
                raise _no_version(wanted)
            return _version(row, _jobs_of(connection, project_id, [wanted])), _unpacked(row["body"])

    def save(self, project_id: str, expected: int, draft: Draft, max_bytes: int | None = None) -> Project:
        """Store `draft` as the version after `expected`. An unchanged document creates no new version. `max_bytes`: as
        for `create`.

        Raises:
            QuotaExceeded: the versions of all projects of the owner would take more.
            NotFound: there is no such project, or it is deleted.
            VersionMismatch: another version than `expected` is the newest.
        """
        with self._db.write() as connection:
            row = _row(connection, project_id, lock=True)
            if row["deleted_at"] is not None:
                raise _no_project(project_id)
            if row["version"] != expected:
                raise VersionMismatch(expected, row["version"])
            if _same(connection, project_id, expected, draft):
                return _project(row)
            _check_quota(connection, row["owner"], draft, max_bytes)
            now = max(self._now(), row["updated_at"])
            changes = {"version": expected + 1, "name": draft.name, "updated_at": now}
            connection.execute(update(schema.projects).where(schema.projects.c.id == project_id).values(changes))
            _write(connection, project_id, expected + 1, now, draft)
            if (expected + 1) % _COUNTED_EVERY == 0:
                _halve(connection, project_id)
            return _project({**row, **changes})

    def versions(self, project_id: str, cursor: str | None = None, limit: int = 50) -> Page:
        """ProjectVersion items, newest first."""
        table = schema.project_versions
        columns = [column for column in table.c if column.name != "body"]
        query = select(*columns).where(table.c.project_id == project_id)
        if cursor is not None:
            query = query.where(table.c.version < unpack_cursor(cursor, int)[0])
        with self._db.read() as connection:
            rows = connection.execute(query.order_by(table.c.version.desc()).limit(limit + 1)).mappings().all()
            jobs = _jobs_of(connection, project_id, [row["version"] for row in rows[:limit]])
        items = tuple(_version(row, jobs) for row in rows[:limit])
        return Page(items, pack_cursor(items[-1].version) if len(rows) > limit else None)

    def label(self, project_id: str, version: int, label: str) -> ProjectVersion:
        """Name a version; named versions are kept. An empty label removes the name. Raises NotFound."""
        table = schema.project_versions
        where = (table.c.project_id == project_id, table.c.version == version)
        with self._db.write() as connection:
            if connection.execute(update(table).where(*where).values(label=label)).rowcount == 0:
                raise _no_version(version)
        return self.document(project_id, version)[0]

    # -- deletion

    def delete(self, project_id: str) -> Project:
        """Mark as deleted; `restore` can undo this until `purge`."""
        return self._mark(project_id, self._now())

    def remove(self, project_id: str) -> None:
        """Remove a project that is marked as deleted, with all versions. No effect on others."""
        table = schema.projects
        with self._db.write() as connection:
            connection.execute(delete(table).where(table.c.id == project_id, table.c.deleted_at.is_not(None)))

    def restore(self, project_id: str) -> Project:
        """Undo a deletion. Raises NotFound once the project was purged."""
        return self._mark(project_id, None)

    def _mark(self, project_id: str, deleted_at: float | None) -> Project:
        with self._db.write() as connection:
            row = _row(connection, project_id, lock=True)
            if (row["deleted_at"] is None) == (deleted_at is None):
                return _project(row)
            table = schema.projects
            connection.execute(update(table).where(table.c.id == project_id).values(deleted_at=deleted_at))
            return _project({**row, "deleted_at": deleted_at})

    def purge(self, undo_s: float) -> int:
        """Purge projects that were deleted more than `undo_s` seconds ago; returns their number."""
        table = schema.projects
        with self._db.write() as connection:
            gone = connection.execute(delete(table).where(table.c.deleted_at < self._now() - undo_s))
            return int(gone.rowcount)

    # -- shares

    def share_epoch(self, project_id: str) -> int:
        """The share epoch; links signed with an earlier epoch are invalid. Raises NotFound."""
        with self._db.read() as connection:
            return int(_row(connection, project_id)["share_epoch"])

    def end_shares(self, project_id: str) -> None:
        """Invalidate every link of the project."""
        table = schema.projects
        with self._db.write() as connection:
            _row(connection, project_id, lock=True)
            raised = update(table).where(table.c.id == project_id).values(share_epoch=table.c.share_epoch + 1)
            connection.execute(raised)

    # -- jobs and assets

    def add_jobs(self, project_id: str, jobs: Iterable[ProjectJob]) -> None:
        """Record jobs that were submitted from the project. Jobs that are already recorded do not change."""
        table = schema.project_jobs
        with self._db.write() as connection:
            _row(connection, project_id, lock=True)
            known = set(connection.execute(select(table.c.job_id).where(table.c.project_id == project_id)).scalars())
            rows = [{"project_id": project_id, **vars(job)} for job in jobs if job.job_id not in known]
            if rows:
                connection.execute(insert(table), rows)

    def jobs(self, project_id: str) -> list[ProjectJob]:
        """Jobs of the project, newest first; some of them may have been deleted."""
        table = schema.project_jobs
        query = select(table).where(table.c.project_id == project_id).order_by(table.c.at.desc(), table.c.job_id.desc())
        with self._db.read() as connection:
            return [_job(row) for row in connection.execute(query).mappings()]

    # -- retention

    def thin(self, retention: Retention) -> int:
        """Delete versions that `retention` does not keep, of a few projects; returns their number. Call it again until
        it is 0."""
        versions = schema.project_versions
        before = self._now() - retention.every_s
        crowded = (
            select(versions.c.project_id)
            .where(versions.c.at < before, versions.c.thinned.is_(False))
            .group_by(versions.c.project_id)
            .limit(_THINNED_AT_ONCE)
        )
        with self._db.read() as connection:
            projects = list(connection.execute(crowded).scalars())
        return sum(self._thin(project_id, before, retention.then_one_in_s) for project_id in projects)

    def _thin(self, project_id: str, before: float, one_in_s: float) -> int:
        table = schema.project_versions
        with self._db.write() as connection:
            newest = _row(connection, project_id, lock=True)["version"]
            old = select(table.c.version, table.c.at, table.c.label).where(
                table.c.project_id == project_id, table.c.at < before
            )
            rows = connection.execute(old.order_by(table.c.version)).mappings().all()
            last = {int(row["at"] // one_in_s): row["version"] for row in rows}
            pinned = {newest, *last.values(), *_jobs_of(connection, project_id, [row["version"] for row in rows])}
            gone = [row["version"] for row in rows if row["version"] not in pinned and not row["label"]]
            _delete_versions(connection, project_id, gone)
            mark = update(table).where(table.c.project_id == project_id, table.c.at < before)
            connection.execute(mark.values(thinned=True))
            if gone:
                _forget_assets(connection, project_id)
            return len(gone)


def _row(connection: Connection, project_id: str, lock: bool = False) -> Row:
    query = select(schema.projects).where(schema.projects.c.id == project_id)
    row = connection.execute(query.with_for_update() if lock else query).mappings().first()
    if row is None:
        raise _no_project(project_id)
    return dict(row)


def _no_project(project_id: str) -> NotFound:
    return NotFound("Project not found.", field="project_id", value=project_id, remedy="See GET /v1/projects.")


def _no_version(version: int) -> NotFound:
    return NotFound(
        "Version not found; old versions are removed.", field="version", value=version,
        remedy="See GET /v1/projects/{id}/versions.",
    )  # fmt: skip


def _write(connection: Connection, project_id: str, version: int, now: float, draft: Draft) -> None:
    row = {"project_id": project_id, "version": version, "at": now, "author": draft.author, "label": "",
           "size_bytes": draft.size_bytes, "body": draft.packed, "thinned": False}  # fmt: skip
    connection.execute(insert(schema.project_versions).values(row))
    table = schema.project_assets
    known = set(connection.execute(select(table.c.asset_id).where(table.c.project_id == project_id)).scalars())
    fresh = sorted(set(draft.asset_ids) - known)
    if fresh:
        connection.execute(insert(table), [{"project_id": project_id, "asset_id": asset} for asset in fresh])
    _add_bytes(connection, project_id, len(draft.packed) + _ROW_BYTES * (1 + len(fresh)))


def _add_bytes(connection: Connection, project_id: str, size_bytes: int) -> None:
    table = schema.projects
    more = update(table).where(table.c.id == project_id).values(stored_bytes=table.c.stored_bytes + size_bytes)
    connection.execute(more)


def _check_quota(connection: Connection, owner: str, draft: Draft, max_bytes: int | None) -> None:
    if max_bytes is None:
        return
    table = schema.projects
    stored = select(func.coalesce(func.sum(table.c.stored_bytes), 0)).where(table.c.owner == owner)
    if int(connection.execute(stored).scalar_one()) + len(draft.packed) > max_bytes:
        raise QuotaExceeded(
            f"The versions of your projects may take {max_bytes} bytes together.",
            field="document", value=len(draft.packed), remedy="Delete projects for good that you no longer need.",
        )  # fmt: skip


def _halve(connection: Connection, project_id: str) -> None:
    """Delete every second version of the older half while there are more than `MOST_VERSIONS`."""
    table = schema.project_versions
    query = select(table.c.version).where(table.c.project_id == project_id, table.c.label == "")
    versions = list(connection.execute(query.order_by(table.c.version)).scalars())
    used = _jobs_of(connection, project_id, versions)
    kept, gone = [version for version in versions if version not in used], list[int]()
    while len(kept) > MOST_VERSIONS:
        older, newer = kept[: len(kept) // 2], kept[len(kept) // 2 :]
        gone += older[::2]
        kept = older[1::2] + newer
    _delete_versions(connection, project_id, gone)


def _delete_versions(connection: Connection, project_id: str, versions: Sequence[int]) -> None:
    table = schema.project_versions
    for start in range(0, len(versions), 500):
        some = (table.c.project_id == project_id, table.c.version.in_(versions[start : start + 500]))
        freed = select(func.coalesce(func.sum(func.length(table.c.body) + _ROW_BYTES), 0)).where(*some)
        _add_bytes(connection, project_id, -int(connection.execute(freed).scalar_one()))
        connection.execute(delete(table).where(*some))


def _same(connection: Connection, project_id: str, version: int, draft: Draft) -> bool:
    table = schema.project_versions
    query = select(table.c.body).where(table.c.project_id == project_id, table.c.version == version)
    return zlib.decompress(connection.execute(query).scalar_one()) == draft.body


def _unpacked(body: bytes) -> Json:
    found: Json = json.loads(zlib.decompress(body))
    return found


def _jobs_of(connection: Connection, project_id: str, versions: Collection[int]) -> dict[int, tuple[str, ...]]:
    table = schema.project_jobs
    query = select(table.c.version, table.c.job_id).where(
        table.c.project_id == project_id, table.c.version.between(min(versions, default=0), max(versions, default=0))
    )
    found: dict[int, tuple[str, ...]] = {}
    for version, job_id in connection.execute(query.order_by(table.c.job_id)):
        found[version] = (*found.get(version, ()), job_id)
    return found


def _forget_assets(connection: Connection, project_id: str) -> None:
    """Release the assets that no version names any more."""
    table, versions = schema.project_assets, schema.project_versions
    query = select(versions.c.body).where(versions.c.project_id == project_id).execution_options(yield_per=1)
    bodies = connection.execute(query).scalars()  # one at a time: together they may be as large as the owner's quota
    named = {ref["id"] for body in bodies for ref in _unpacked(body).get("assets", {}).values()}
    stored = set(connection.execute(select(table.c.asset_id).where(table.c.project_id == project_id)).scalars())
    for asset_id in sorted(stored - named):
        connection.execute(delete(table).where(table.c.project_id == project_id, table.c.asset_id == asset_id))


def _project(row: Row) -> Project:
    return Project(**{name: row[name] for name in Project.__dataclass_fields__})


def _version(row: Row, jobs: Mapping[int, tuple[str, ...]]) -> ProjectVersion:
    names = [name for name in ProjectVersion.__dataclass_fields__ if name != "jobs"]
    return ProjectVersion(**{name: row[name] for name in names}, jobs=jobs.get(row["version"], ()))


def _job(row: Row) -> ProjectJob:
    return ProjectJob(**{name: row[name] for name in ProjectJob.__dataclass_fields__})
