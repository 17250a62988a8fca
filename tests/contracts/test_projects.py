"""The contract of the project store, on every database."""

from __future__ import annotations

import random
import threading
from collections.abc import Iterator
from contextlib import nullcontext

import pytest
from sqlalchemy import event

from tests.contracts.databases import DATABASES
from workers.contract.project import ProjectJob, VersionMismatch
from workers.contract.record import Asset
from workers.errors import Conflict, NotFound, QuotaExceeded
from workers.store import Store
from workers.store.projects import Draft, Retention

DAY_S = 86400.0


class Clock:
    now = 1_000_000.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture(params=DATABASES)
def store(request: pytest.FixtureRequest, clock: Clock) -> Iterator[Store]:
    opened = Store(DATABASES[request.param](request, True), now=clock)
    yield opened
    opened.close()


def _draft(name: str = "Swan", *assets: str, **more: object) -> Draft:
    named = {f"n{number}": {"id": asset} for number, asset in enumerate(assets)}
    return Draft({"schema": 1, "name": name, "assets": named, **more}, name, assets, "anna")


def test_a_project_document_round_trips(store: Store) -> None:
    document = {"schema": 1, "name": "Schwän \U0001f9a2", "z": 1, "a": [1.5, None, True]}
    project = store.projects.create(Draft(document, "Schwän", (), "anna"), "anna")
    version, found = store.projects.document(project.id)
    assert list(found.items()) == list(document.items()), "members keep their order"
    assert (version.version, version.author, project.owner) == (1, "anna", "anna")


def test_every_project_version_is_kept_and_a_change_requires_the_newest(store: Store) -> None:
    project = store.projects.create(_draft(), "anna")
    for number in range(1, 4):
        assert store.projects.save(project.id, number, _draft(f"Swan {number}")).version == number + 1
    with pytest.raises(VersionMismatch) as caught:
        store.projects.save(project.id, 2, _draft("late"))
    assert (caught.value.expected, caught.value.stored) == (2, 4)
    assert store.projects.get(project.id).name == "Swan 3"
    assert [store.projects.document(project.id, number)[1]["name"] for number in (1, 2, 3, 4)] == [
        "Swan", "Swan 1", "Swan 2", "Swan 3",
    ]  # fmt: skip


def test_saving_an_unchanged_project_creates_no_version(store: Store) -> None:
    project = store.projects.create(_draft(), "anna")
    assert store.projects.save(project.id, 1, _draft()) == project


def test_one_of_two_simultaneous_saves_is_refused(store: Store) -> None:
    project = store.projects.create(_draft(), "anna")
    ready, outcomes = threading.Barrier(4), []

    def save(number: int) -> None:
        ready.wait()
        try:
            outcomes.append(store.projects.save(project.id, 1, _draft(f"by {number}")).version)
        except VersionMismatch as error:
            outcomes.append(-error.stored)

    threads = [threading.Thread(target=save, args=(number,)) for number in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(outcomes) == [-2, -2, -2, 2]


def test_projects_are_listed_per_owner_newest_change_first(store: Store, clock: Clock) -> None:
    made = []
    for number in range(5):
        clock.now += 1
        made.append(store.projects.create(_draft(f"p{number}"), "anna" if number < 4 else "ben"))
    clock.now += 1
    store.projects.save(made[0].id, 1, _draft("p0 again"))
    first = store.projects.page("anna", False, None, 3)
    rest = store.projects.page("anna", False, first.cursor, 3)
    assert [p.name for p in (*first.items, *rest.items)] == ["p0 again", "p3", "p2", "p1"]
    assert rest.cursor is None
    assert len(store.projects.page(None, False, None, 50).items) == 5


def test_a_project_deletion_can_be_undone_until_it_is_purged(store: Store, clock: Clock) -> None:
    project = store.projects.create(_draft(), "anna")
    assert store.projects.delete(project.id).deleted_at == clock.now
    with pytest.raises(NotFound):
        store.projects.save(project.id, 1, _draft("changed"))
    assert store.projects.page("anna", False, None, 9).items == ()
    assert [p.id for p in store.projects.page("anna", True, None, 9).items] == [project.id]
    assert store.projects.purge(DAY_S) == 0
    assert store.projects.restore(project.id) == project
    store.projects.delete(project.id)
    clock.now += DAY_S + 1
    assert store.projects.purge(DAY_S) == 1
    with pytest.raises(NotFound):
        store.projects.restore(project.id)


def test_an_asset_of_any_project_version_cannot_be_deleted(store: Store, clock: Clock) -> None:
    ids = [f"ast_{letter * 64}" for letter in "ab"]
    for asset_id in ids:
        store.assets.add(Asset(asset_id, asset_id[4:], 1, "x", "image/png", "image", {}, 1.0, "anna"), lambda: True)
    project = store.projects.create(_draft("Swan", ids[0]), "anna")
    store.projects.save(project.id, 1, _draft("Swan", ids[1]))
    for asset_id in ids:
        with pytest.raises(Conflict, match="project 'Swan'"):
            store.assets.remove(asset_id, "anna")
    store.projects.delete(project.id)
    clock.now += DAY_S
    store.projects.purge(1.0)
    assert store.assets.remove(ids[0], "anna")


def test_versions_are_thinned_out_after_a_week(store: Store, clock: Clock) -> None:
    clock.now = 1_000_800.0  # the start of an hour
    project = store.projects.create(_draft("v1", "ast_1"), "anna")
    for number in range(1, 8):  # versions 2 to 8, ten minutes apart
        clock.now += 600
        named = ("ast_1",) if number == 1 else ("ast_2",)
        store.projects.save(project.id, number, _draft(f"v{number + 1}", *named))
    store.projects.label(project.id, 3, "for Ann")
    store.projects.add_jobs(project.id, [ProjectJob("job_1", "s1", None, 4, clock.now)])
    assert store.projects.thin(Retention()) == 0
    clock.now += 7 * DAY_S
    assert store.projects.save(project.id, 8, _draft("v9", "ast_2")).version == 9
    assert store.projects.thin(Retention()) == 3
    assert [v.version for v in store.projects.versions(project.id).items] == [9, 8, 7, 6, 4, 3]
    with pytest.raises(NotFound, match="old versions are removed"):
        store.projects.document(project.id, 2)
    assert store.projects.thin(Retention()) == 0
    with store.database.read() as connection:
        from workers.store import schema

        assert [row.asset_id for row in connection.execute(schema.project_assets.select())] == ["ast_2"]


def test_jobs_of_a_version_are_listed_with_it(store: Store) -> None:
    project = store.projects.create(_draft(), "anna")
    jobs = [ProjectJob("job_1", "s1", None, 1, 5.0), ProjectJob("job_2", "s1", "v1", 1, 6.0)]
    store.projects.add_jobs(project.id, jobs)
    store.projects.add_jobs(project.id, jobs[:1])
    assert store.projects.jobs(project.id) == jobs[::-1]
    assert store.projects.versions(project.id).items[0].jobs == ("job_1", "job_2")


def test_ending_shares_raises_the_epoch(store: Store) -> None:
    project = store.projects.create(_draft(), "anna")
    store.projects.end_shares(project.id)
    assert store.projects.share_epoch(project.id) == 1


def _noise(number: int) -> Draft:
    """A document of about 10 kB that does not become smaller by compression."""
    return _draft(ui=random.Random(number).randbytes(5000).hex())


def test_versions_count_for_the_quota_of_their_owner(store: Store) -> None:
    one = store.projects.create(_noise(0), "anna", 32_000)
    for version in range(1, 5):
        store.projects.save(one.id, version, _noise(version), 32_000)
    for owner, refused in (("anna", True), ("ben", False)):
        with pytest.raises(QuotaExceeded) if refused else nullcontext():
            store.projects.create(_noise(9), owner, 32_000)
    with pytest.raises(QuotaExceeded):
        store.projects.save(one.id, 5, _noise(9), 32_000)
    assert store.projects.save(one.id, 5, _noise(9)).version == 6, "without a quota"
    store.projects.delete(one.id)
    with pytest.raises(QuotaExceeded):
        store.projects.create(_noise(10), "anna", 32_000)
    store.projects.remove(one.id)
    assert store.projects.create(_noise(10), "anna", 32_000).version == 1


def test_only_a_deleted_project_is_removed(store: Store) -> None:
    project = store.projects.create(_draft(), "anna")
    store.projects.remove(project.id)
    assert store.projects.get(project.id) == project


def test_the_number_of_versions_is_bounded(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("workers.store.projects.MOST_VERSIONS", 60)
    project = store.projects.create(_draft(), "anna")
    store.projects.label(project.id, 1, "first")
    store.projects.add_jobs(
        project.id, [ProjectJob("job_1", "s1", None, 1, 0.0), ProjectJob("job_2", "s1", None, 3, 0.0)]
    )
    for version in range(1, 400):
        store.projects.save(project.id, version, _draft(f"v{version}"))
    kept = [one.version for one in store.projects.versions(project.id, limit=200).items]
    assert len(kept) <= 60 + 50 + 2 and {1, 3, 400} <= set(kept)
    assert kept[:30] == list(range(400, 370, -1)), "the newest are all kept"
    with store.database.read() as connection:
        from workers.store import schema

        rows = connection.execute(schema.project_versions.select()).mappings().all()
        (stored,) = connection.execute(schema.projects.select()).mappings()
    assert stored["stored_bytes"] == sum(len(row["body"]) + 256 for row in rows)


def test_assets_of_a_document_are_found_by_one_query(store: Store) -> None:
    ids = [f"ast_{number:064x}" for number in range(20_000)]
    asset = Asset(ids[7], ids[7][4:], 3, "a.png", "image/png", "image", {}, 0.0, "anna")
    store.assets.add(asset, lambda: True)
    queries: list[str] = []
    event.listen(store.database.engine, "before_cursor_execute", lambda *args: queries.append(args[2]))
    assert store.assets.owned(ids, "anna") == {ids[7]: asset}
    assert store.assets.owned(ids, "ben") == {}
    assert len([query for query in queries if "asset_owners" in query]) == 2
