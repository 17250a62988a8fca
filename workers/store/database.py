"""The database connection: opened, migrated, and used in two kinds of transaction, `read` and `write`.

SQLite runs in WAL mode, so that readers never wait, with `synchronous=FULL`: a commit is on the disk when it returns,
because an accepted job must survive a power cut. With a few commits a second, the flushes cost little. `impasto render`
uses NORMAL for its own database: a power cut may lose the last commits and leaves the database consistent. SQLite's
writers begin with BEGIN IMMEDIATE, one at a time, so that no transaction has to fail in the middle because another
wrote first.

PostgreSQL commits synchronously by default; leave it so. Connections that a network failure has cut are detected within
half a minute, and waits for locks and queries have time-outs.
"""

from __future__ import annotations

import sqlite3
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from functools import partial
from pathlib import Path
from typing import Any

from sqlalchemy import URL, Connection, Engine, create_engine, event, make_url, text
from sqlalchemy.exc import ArgumentError, DatabaseError, DataError, DBAPIError, InterfaceError, OperationalError
from sqlalchemy.exc import TimeoutError as PoolTimeout

from pipeline.errors import BadParameter, StorageError, StorageFull
from workers.store.clock import ServerClock
from workers.store.migrate import migrate

BUSY_TIMEOUT_S = 20
_READ = "impasto_read"
_POSTGRES = {
    "application_name": "impasto",
    "connect_timeout": 5,
    "keepalives_idle": 10,
    "keepalives_interval": 5,
    "keepalives_count": 3,
    "tcp_user_timeout": 25_000,
    "options": "-c lock_timeout=20s -c statement_timeout=120s -c idle_in_transaction_session_timeout=120s",
}
"""Connection parameters of PostgreSQL."""
_READ_ONLY = "25006"
"""SQLSTATE of PostgreSQL after a fail-over: the connected server is now a read-only standby."""


class Database:
    """One database. Thread-safe.

    Args:
        url: SQLAlchemy URL, `sqlite:///path` or `postgresql://...`. A missing SQLite file is made.
        durable: whether a commit in SQLite is on the disk when it returns.

    Attributes:
        engine: the pool of connections, for its events; use `read` and `write` for statements.

    Raises:
        StorageError: it cannot be reached, or is newer than this program.
        BadParameter: the URL names an unsupported database.
    """

    def __init__(self, url: str, durable: bool = True) -> None:
        self.engine = _engine(url, durable)
        self._one_writer = threading.RLock() if self.is_sqlite else nullcontext()
        self._clock = None if self.is_sqlite else ServerClock()
        with _as_storage_error():
            self._migrate()
        self._file = _StoredFile(self.engine.url.database) if self.is_sqlite else None

    @property
    def is_sqlite(self) -> bool:
        return self.engine.dialect.name == "sqlite"

    def now(self) -> float:
        """Seconds since the epoch, from a clock that all users of this database share."""
        return time.time() if self._clock is None else self._clock()

    @contextmanager
    def read(self) -> Iterator[Connection]:
        """A snapshot to read from."""
        self._check_file()
        with _as_storage_error(), self.engine.connect().execution_options(**{_READ: True}) as connection:
            self._synchronize_clock(connection)
            yield connection

    @contextmanager
    def snapshot(self) -> Iterator[Connection]:
        """A snapshot of the database for several queries; writing is refused."""
        options = {} if self.is_sqlite else {"isolation_level": "REPEATABLE READ", "postgresql_readonly": True}
        with _as_storage_error(), self.engine.connect() as raw:
            connection = raw.execution_options(**{_READ: True}, **options)
            if self.is_sqlite:
                connection.exec_driver_sql("PRAGMA query_only=ON")
            try:
                yield connection
            finally:
                if self.is_sqlite:
                    connection.exec_driver_sql("PRAGMA query_only=OFF")

    @contextmanager
    def write(self) -> Iterator[Connection]:
        """A transaction: committed at the end, rolled back by any exception."""
        self._check_file()
        with _as_storage_error(), self._one_writer, self.engine.begin() as connection:
            self._synchronize_clock(connection)
            yield connection

    def lock(self, connection: Connection, name: str) -> None:
        """Lock `name` until this write transaction ends: for rows that do not exist yet and so cannot be locked."""
        if not self.is_sqlite:  # SQLite has one writer at a time
            connection.execute(text("SELECT pg_advisory_xact_lock(hashtextextended(:name, 482309))"), {"name": name})

    def _synchronize_clock(self, connection: Connection) -> None:
        if self._clock is not None:
            self._clock.synchronize(connection)

    def _check_file(self) -> None:
        """Raise StorageError if the file of SQLite is no longer at its place: what is written to a deleted file is lost
        when the process ends."""
        if self._file is not None:
            self._file.check()

    def check(self) -> None:
        """Raise StorageError if the database does not answer now."""
        with self.read() as connection:
            connection.execute(text("SELECT 1"))

    def close(self) -> None:
        self.engine.dispose()

    def _migrate(self) -> None:
        with self._one_writer, self.engine.begin() as connection:
            if not self.is_sqlite:  # two processes may start at once; SQLite's BEGIN IMMEDIATE has settled that
                for setting in ("statement_timeout", "lock_timeout"):  # may take minutes for a large database
                    connection.execute(text(f"SET LOCAL {setting} = 0"))
                connection.execute(text("SELECT pg_advisory_xact_lock(482309)"))
            migrate(connection)


class _StoredFile:
    """The file of a database, as it was when it was opened."""

    def __init__(self, path: str | None) -> None:
        self._path = None if path in (None, "", ":memory:") else Path(str(path))
        self._inode = self._found()

    def _found(self) -> tuple[int, int] | None:
        try:
            found = None if self._path is None else self._path.stat()
        except OSError:
            return None
        return found and (found.st_dev, found.st_ino)

    def check(self) -> None:
        """Raise StorageError if the file was deleted or replaced."""
        if self._path is not None and self._found() != self._inode:
            raise StorageError(
                f"The database file was deleted or replaced while it was in use: {self._path}.",
                remedy="Restore it if you need it, then restart the service: nothing new is accepted until then.",
            )


def _file_error(reason: str) -> StorageError:
    """The error of SQLite, which has no server that could be down."""
    if "locked" in reason:
        return StorageError(f"The database file is in use: {reason}.", remedy="Try again shortly.")
    return StorageError(
        f"The database file cannot be opened, read or written: {reason}.",
        remedy="Make the home writable for this user, keep its path under 500 characters, and check the disk.",
    )


def _engine(url: str, durable: bool) -> Engine:
    parsed = _parse(url)
    if parsed.get_backend_name() != "sqlite":
        from workers.store.postgres import connect  # its driver is an extra

        engine = create_engine(
            parsed, pool_pre_ping=True, pool_size=10, max_overflow=20, pool_timeout=10, connect_args=_POSTGRES
        )
        event.listen(engine, "do_connect", connect)
        return engine
    _make_folder(Path(parsed.database or "."))
    engine = create_engine(
        parsed, connect_args={"timeout": BUSY_TIMEOUT_S}, pool_size=10, max_overflow=40, pool_timeout=10
    )
    event.listen(engine, "connect", partial(_prepare_sqlite, "FULL" if durable else "NORMAL"))
    event.listen(engine, "begin", _begin_sqlite)
    return engine


def _parse(url: str) -> URL:
    """The URL with its driver, for the short forms postgresql:// and postgres://."""
    known = {"postgres": "postgresql+psycopg", "postgresql": "postgresql+psycopg"}
    try:
        parsed = make_url(url)
    except ArgumentError:
        parsed = None
    if parsed is None or parsed.get_backend_name() not in ("sqlite", "postgresql", "postgres"):
        remedy = "Use sqlite:///path or postgresql://user:password@host/name."
        raise BadParameter("The URL names no supported database.", field="database_url", remedy=remedy)
    return parsed.set(drivername=known.get(parsed.drivername, parsed.drivername))


def _make_folder(database: Path) -> None:
    try:
        database.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StorageError(f"The database's folder cannot be made: {error}.", remedy="Choose another home.") from error


def _prepare_sqlite(synchronous: str, connection: Any, _record: Any) -> None:
    connection.isolation_level = None  # BEGIN is sent explicitly
    wait_ms = BUSY_TIMEOUT_S * 1000
    for pragma in ("journal_mode=WAL", f"synchronous={synchronous}", "foreign_keys=ON", f"busy_timeout={wait_ms}"):
        connection.execute(f"PRAGMA {pragma}").close()


def _begin_sqlite(connection: Connection) -> None:
    reading = connection.get_execution_options().get(_READ, False)
    connection.exec_driver_sql("BEGIN" if reading else "BEGIN IMMEDIATE")


@contextmanager
def _as_storage_error() -> Iterator[None]:
    """Convert errors of the connection to StorageError; errors of our statements (a bug) pass unchanged.

    Text that a database cannot store (lone surrogates, NUL in PostgreSQL) comes from users and raises BadParameter.
    """
    try:
        yield
    except (UnicodeEncodeError, DataError) as error:
        remedy = "Use plain Unicode text without control characters."
        raise BadParameter("A text has characters that cannot be stored.", field="text", remedy=remedy) from error
    except PoolTimeout as error:
        raise StorageError("The database has no free connection.", remedy="Try again shortly.") from error
    except DBAPIError as error:
        reason = str(error.orig)
        if "disk is full" in reason or "No space left" in reason or "disk full" in reason:
            raise StorageFull("The disk of the database is full.", remedy="Free some space on it.") from error
        away = type(error) in (OperationalError, InterfaceError, DatabaseError) or error.connection_invalidated
        if away and isinstance(error.orig, sqlite3.Error):
            raise _file_error(reason) from error
        if away or getattr(error.orig, "sqlstate", "") == _READ_ONLY:
            raise StorageError(f"The database does not answer: {reason}.", remedy="Check that it runs.") from error
        raise
