"""A PostgreSQL of its own in a temporary folder, reached by a socket in it: no port, no password, no root."""

from __future__ import annotations

import itertools
import os
import shutil
import signal
import subprocess
from pathlib import Path

import psycopg
from sqlalchemy import make_url

from tests.real.processes import as_user, delete_later, end, folder_of, nobody_special, start, until
from workers.store import Store

_PLACES = "/usr/lib/postgresql"
_TEMPLATE = "migrated"


def binary(name: str) -> Path | None:
    """One of PostgreSQL's programs: Debian keeps the server's out of the PATH."""
    versions = sorted(Path(_PLACES).glob(f"*/bin/{name}"), key=lambda path: float(path.parts[-3]))
    found = str(versions[-1]) if versions else shutil.which(name)
    return Path(found) if found else None


def missing() -> str:
    """Why there can be no server here; empty if there can."""
    lacks = [name for name in ("initdb", "postgres", "pg_dump", "pg_restore") if binary(name) is None]
    return f"there is no {lacks[0]}: apt-get install postgresql" if lacks else ""


class Postgres:
    """The server, through stops and kills. Files are not flushed (the machine does not die in a test)."""

    def __init__(self) -> None:
        self._user = nobody_special()
        self.folder = folder_of(self._user, "impasto-pg-")
        self._log = self.folder.with_suffix(".log")
        self._process: subprocess.Popen[bytes] | None = None
        self._numbers = itertools.count(1)
        setup = ["-D", self._data, "-U", "impasto", "-A", "trust", "-E", "UTF8", "--locale=C", "--no-sync"]
        self.run("initdb", *setup, "--no-instructions")

    @property
    def _data(self) -> str:
        return str(self.folder / "data")

    @property
    def process(self) -> subprocess.Popen[bytes]:
        assert self._process is not None, "it was not started"
        return self._process

    def run(self, program: str, *words: str) -> None:
        """Run one of PostgreSQL's programs as the server's user, to its end."""
        command = [*as_user(self._user), str(binary(program)), *words]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, cwd=self.folder, env=self._env)

    @property
    def _env(self) -> dict[str, str]:
        return {**os.environ, "PGHOST": str(self.folder), "PGUSER": "impasto", "LC_ALL": "C"}

    def start(self) -> None:
        quick = ("fsync=off", "full_page_writes=off", "shared_buffers=32MB", "max_connections=200", "jit=off")
        settings = ["listen_addresses=", f"unix_socket_directories={self.folder}", *quick]
        words = [word for setting in settings for word in ("-c", setting)]
        command = [*as_user(self._user), str(binary("postgres")), "-D", self._data, *words]
        self._process = start(command, self._log, self._env)
        until(self._answers, self._process, self._log)

    def _answers(self) -> bool:
        try:
            self.execute("SELECT 1")
        except psycopg.OperationalError:
            return False
        return True

    def execute(self, statement: str, database: str = "postgres") -> list[tuple[object, ...]]:
        """Run one statement outside any transaction."""
        where = f"host={self.folder} user=impasto dbname={database}"
        with psycopg.connect(where, autocommit=True, connect_timeout=5) as connection:
            found = connection.execute(statement)
            return list(found.fetchall()) if found.description else []

    def url(self, database: str) -> str:
        return f"postgresql+psycopg://impasto@/{database}?host={self.folder}"

    def empty(self) -> str:
        """The URL of a new, empty database."""
        name = f"t{next(self._numbers)}"
        self.execute(f"CREATE DATABASE {name}")
        return self.url(name)

    def fresh(self) -> str:
        """The URL of a new database with the tables of the newest schema: a copy, which is quicker than migrating."""
        if not self.execute(f"SELECT 1 FROM pg_database WHERE datname = '{_TEMPLATE}'"):
            self.execute(f"CREATE DATABASE {_TEMPLATE}")
            Store(self.url(_TEMPLATE)).close()
        return self.copy(self.url(_TEMPLATE))

    def copy(self, url: str) -> str:
        """The URL of a new database, equal to the one at `url`, to which nothing may be connected."""
        name = f"t{next(self._numbers)}"
        source = make_url(url).database
        self.execute(f"CREATE DATABASE {name} TEMPLATE {source} STRATEGY FILE_COPY")
        return self.url(name)

    def stop(self, how: signal.Signals = signal.SIGINT) -> None:
        """Stop it: SIGINT cuts every connection; SIGQUIT ends without a clean shutdown, like a crash."""
        end(self.process, how)

    def close(self) -> None:
        """Stop it finally and delete its folder."""
        self.stop(signal.SIGQUIT)
        delete_later(self.folder)
        self._log.unlink(missing_ok=True)
