"""The connection: opened, migrated, and used through two kinds of transaction, `read` and `write`.

SQLite runs in WAL mode, so that readers never wait, with `synchronous=FULL`: a commit is on the disk when it returns,
because an accepted job must survive a power cut (NORMAL may lose the last commits). There are a few commits a second;
the flush does not show. Its writers begin with BEGIN IMMEDIATE, one at a time, so that no transaction has to fail in
the middle because another wrote first.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any

from alembic import command
from alembic.config import Config
from sqlalchemy import Connection, Engine, create_engine, event, make_url, text
from sqlalchemy.exc import DatabaseError, DataError, DBAPIError, InterfaceError, OperationalError
from sqlalchemy.exc import TimeoutError as PoolTimeout

from pipeline.errors import BadParameter, StorageError, StorageFull

BUSY_TIMEOUT_S = 20
_READ = "impasto_read"


class Database:
    """One database. Thread-safe.

    Args:
        url: SQLAlchemy URL, `sqlite:///path` or `postgresql+psycopg://...`. A missing SQLite file is made.

    Raises:
        StorageError: it cannot be reached or is newer than this program.
    """

    def __init__(self, url: str) -> None:
        self._engine = _engine(url)
        self._one_writer = threading.RLock() if self.is_sqlite else nullcontext()
        with _as_storage_error():
            self._migrate()

    @property
    def is_sqlite(self) -> bool:
        return self._engine.dialect.name == "sqlite"

    @contextmanager
    def read(self) -> Iterator[Connection]:
        """A snapshot to read from."""
        with _as_storage_error(), self._engine.connect().execution_options(**{_READ: True}) as connection:
            yield connection

    @contextmanager
    def write(self) -> Iterator[Connection]:
        """A transaction: committed at the end, rolled back by any exception."""
        with _as_storage_error(), self._one_writer, self._engine.begin() as connection:
            yield connection

    def check(self) -> None:
        """Raise StorageError if the database does not answer now."""
        with self.read() as connection:
            connection.execute(text("SELECT 1"))

    def close(self) -> None:
        self._engine.dispose()

    def _migrate(self) -> None:
        config = Config()
        config.set_main_option("script_location", str(Path(__file__).parent / "migrations"))
        with self._one_writer, self._engine.begin() as connection:
            if not self.is_sqlite:  # two processes may start at once; SQLite's BEGIN IMMEDIATE has settled that
                connection.execute(text("SELECT pg_advisory_xact_lock(482309)"))
            config.attributes["connection"] = connection
            command.upgrade(config, "head")


def _engine(url: str) -> Engine:
    parsed = make_url(url)
    if parsed.get_backend_name() != "sqlite":
        return create_engine(parsed, pool_pre_ping=True, pool_size=10, max_overflow=20, pool_timeout=10)
    _make_folder(Path(parsed.database or "."))
    engine = create_engine(parsed, connect_args={"timeout": BUSY_TIMEOUT_S}, pool_size=10, max_overflow=40)
    event.listen(engine, "connect", _prepare_sqlite)
    event.listen(engine, "begin", _begin_sqlite)
    return engine


def _make_folder(database: Path) -> None:
    try:
        database.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StorageError(f"The database's folder cannot be made: {error}.", remedy="Choose another home.") from error


def _prepare_sqlite(connection: Any, _record: Any) -> None:
    connection.isolation_level = None  # we say BEGIN ourselves
    for pragma in ("journal_mode=WAL", "synchronous=FULL", "foreign_keys=ON", f"busy_timeout={BUSY_TIMEOUT_S * 1000}"):
        connection.execute(f"PRAGMA {pragma}").close()


def _begin_sqlite(connection: Connection) -> None:
    reading = connection.get_execution_options().get(_READ, False)
    connection.exec_driver_sql("BEGIN" if reading else "BEGIN IMMEDIATE")


@contextmanager
def _as_storage_error() -> Iterator[None]:
    """Errors of the connection become StorageError; those of our statements (a bug) stay what they are.

    Text that no database can keep (lone surrogates, NUL in PostgreSQL) comes from users: BadParameter.
    """
    try:
        yield
    except (UnicodeEncodeError, DataError) as error:
        remedy = "Use plain Unicode text without control characters."
        raise BadParameter("A text has characters that cannot be stored.", field="text", remedy=remedy) from error
    except PoolTimeout as error:
        raise StorageError("The database has no free connection.", remedy="Try again shortly.") from error
    except DBAPIError as error:
        said = str(error.orig)
        if "disk is full" in said or "No space left" in said or "disk full" in said:
            raise StorageFull("The disk of the database is full.", remedy="Free some space on it.") from error
        if type(error) in (OperationalError, InterfaceError, DatabaseError) or error.connection_invalidated:
            raise StorageError(f"The database does not answer: {said}.", remedy="Check that it runs.") from error
        raise
