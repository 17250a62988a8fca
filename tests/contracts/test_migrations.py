"""A database of any earlier version is migrated, and its unfinished work continues."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor

import pytest
from alembic import command
from alembic.autogenerate import compare_metadata
from alembic.config import Config
from alembic.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy import create_engine, inspect, text

from pipeline.errors import BadParameter, StorageError
from pipeline.methods.base import Task
from tests.contracts.databases import DATABASES
from tests.contracts.released import RELEASED
from tests.real.postgres import Postgres
from workers.contract.order import TaskOutcome
from workers.contract.owners import OwnerKind, Role
from workers.store import Store, schema
from workers.store.migrate import FOLDER, newest_version


@pytest.fixture(params=DATABASES)
def url(request: pytest.FixtureRequest) -> str:
    return DATABASES[request.param](request, False)


def _at(url: str, revision: str) -> None:
    """A database in the state of the version with that revision."""
    config = Config()
    config.set_main_option("script_location", str(FOLDER))
    engine = create_engine(url)
    with engine.begin() as connection:
        config.attributes["connection"] = connection
        command.upgrade(config, revision)
        for row in RELEASED.get(revision, ()):
            connection.execute(text(row.replace(":", r"\:")))
    engine.dispose()


@pytest.mark.parametrize("revision", RELEASED)
def test_jobs_of_an_earlier_schema_version_continue(url: str, revision: str) -> None:
    _at(url, revision)
    store = Store(url, now=lambda: 20.0)
    with store.database.read() as connection:
        assert compare_metadata(MigrationContext.configure(connection), schema.metadata) == []
    assert [job.id for job in store.jobs.page("running").items] == ["job_1"]
    assert store.assets.get("ast_" + "a" * 64, "anna").filename == "cat.mp4"
    assert [todo.job_id for todo in store.plans.to_plan()] == ["job_2"]
    claim = store.queue.claim("new", 30)
    assert claim is not None and claim.task["id"] == "tsk_2"
    assert store.queue.claim("new", 30) is None, "the other one still runs, and a paused job starts nothing"
    assert store.queue.interrupt([]) == 0, "its dispatcher has its lease for 10 s more"
    assert store.queue.interrupt(["dsp_old@host"]) == 1
    for answered in (claim, store.queue.claim("new", 30)):
        assert answered is not None
        assert store.queue.finish(TaskOutcome(answered.attempt_id, {}, {}, {}, None, {}, ""))
    assert store.plans.planned("job_1", 1, (Task("last"),))
    store.close()


def test_a_new_database_has_the_tables_of_an_upgraded_one(url: str) -> None:
    Store(url).close()
    new = _tables(url)
    engine = create_engine(url)
    with engine.begin() as connection:
        schema.metadata.drop_all(connection)
        connection.execute(text("DROP TABLE alembic_version"))
    engine.dispose()
    _at(url, newest_version())
    assert new == _tables(url)
    assert set(new) == {*schema.metadata.tables, "alembic_version"}


def _tables(url: str) -> dict[str, list[str]]:
    """Columns with types and defaults, keys, indexes and constraints of every table."""
    engine = create_engine(url)
    with engine.connect() as connection:
        found = inspect(connection)
        parts = (
            found.get_columns, found.get_indexes, found.get_foreign_keys, found.get_unique_constraints,
            found.get_check_constraints, lambda table: [found.get_pk_constraint(table)],
        )  # fmt: skip
        names = found.get_table_names()
        tables = {name: sorted(_text(row) for part in parts for row in part(name)) for name in names}
    engine.dispose()
    return tables


def _text(value: object) -> str:
    """The same text for equal values, also within: conditions of partial indexes are objects without equality."""
    if isinstance(value, Mapping):
        return str(sorted((key, _text(part)) for key, part in value.items()))
    return str(value)


def test_a_database_of_a_newer_schema_version_is_refused_unchanged(url: str) -> None:
    Store(url).close()
    engine = create_engine(url)
    with engine.begin() as connection:
        connection.execute(text("UPDATE alembic_version SET version_num = '9999'"))
    with pytest.raises(StorageError, match="newer version"):
        Store(url)
    engine.dispose()


def test_the_newest_version_is_the_head_of_the_migrations() -> None:
    config = Config()
    config.set_main_option("script_location", str(FOLDER))
    assert newest_version() == ScriptDirectory.from_config(config).get_current_head()


def test_processes_starting_together_migrate_once(url: str) -> None:
    with ThreadPoolExecutor(4) as threads:
        stores = list(threads.map(lambda _: Store(url), range(4)))
    for store in stores:
        store.check()
        store.close()


@pytest.mark.parametrize("wrong", ["mysql://host/name", "nonsense", "postgresql"])
def test_a_url_that_names_no_database_is_refused(wrong: str) -> None:
    with pytest.raises(BadParameter, match="database_url"):
        Store(wrong)


def test_every_form_of_a_postgres_url_is_accepted(postgres: Postgres) -> None:
    url = postgres.fresh()
    for written in ("postgres://", "postgresql://", "postgresql+psycopg://"):
        store = Store(url.replace("postgresql+psycopg://", written))
        store.check()
        store.close()


def test_a_key_of_an_earlier_version_becomes_the_first_key_of_its_owner(url: str) -> None:
    """Its id stays the owner of what it made. A program of that version may still run beside, and create keys."""
    _at(url, "0007")
    engine = create_engine(url)
    row = """INSERT INTO api_keys (id, name, hash, scopes, quotas, created_at)
        VALUES ('%s', 'anna', '%s', '["read"]', '{"active_jobs"\\: 2}', 1)"""
    with engine.begin() as connection:
        connection.execute(text(row % ("key_1", hashlib.sha256(b"secret").hexdigest())))
    store = Store(url)
    with engine.begin() as connection:
        connection.execute(text(row % ("key_2", "h")))
    engine.dispose()
    assert [(key.id, key.owner, key.quotas) for key in store.keys.list()] == [
        ("key_1", "key_1", {"active_jobs": 2}),
        ("key_2", "key_2", {"active_jobs": 2}),
    ]
    key, _ = store.keys.rotate("key_1")
    assert key.owner == "key_1" and store.keys.verify("impasto_1_secret") is None
    store.close()


def test_owners_of_an_earlier_version_become_users_and_lose_nothing(url: str) -> None:
    """A database of revision 11: an owner with two keys, one of them revoked, and a key that an older program made."""
    _at(url, "0011")
    engine = create_engine(url)
    secret = hashlib.sha256(b"secret").hexdigest()
    rows = [
        """INSERT INTO owners (id, name, quotas, created_at) VALUES ('key_1', 'anna', '{"active_jobs"\\: 2}', 1)""",
        """INSERT INTO api_keys (id, owner, name, hash, scopes, quotas, created_at, revoked_at)
            VALUES ('key_1', 'key_1', 'anna', 'h', '["read"]', '{}', 1, 2)""",
        f"""INSERT INTO api_keys (id, owner, name, hash, scopes, quotas, created_at)
            VALUES ('key_2', 'key_1', 'laptop', '{secret}', '["read"]', '{{}}', 1)""",
        """INSERT INTO api_keys (id, name, hash, scopes, quotas, created_at)
            VALUES ('key_3', 'ben', 'h', '["read"]', '{"asset_bytes"\\: 9}', 3)""",
        """INSERT INTO projects (id, owner, name, version, created_at, updated_at, share_epoch)
            VALUES ('prj_1', 'key_1', 'Film', 1, 1, 1, 0)""",
    ]
    with engine.begin() as connection:
        for row in rows:
            connection.execute(text(row))
    engine.dispose()
    store = Store(url)
    users = {owner.id: (owner.kind, owner.name, owner.quotas) for owner in store.owners.all()}
    assert users == {"key_1": ("user", "anna", {"active_jobs": 2}), "key_3": ("user", "ben", {"asset_bytes": 9})}
    key = store.keys.verify("impasto_2_secret")
    assert key is not None and (key.owner, key.quotas) == ("key_1", {"active_jobs": 2})
    assert [project.id for project in store.projects.page("key_1", False, None, 10).items] == ["prj_1"]
    new, _ = store.keys.create("desk", ["read"], owner="key_1")
    group = store.owners.add("Show", OwnerKind.GROUP).id
    store.owners.put_member(group, new.owner, Role.EDITOR)
    assert store.owners.role("key_1", group) == (Role.EDITOR, {})
    store.close()
