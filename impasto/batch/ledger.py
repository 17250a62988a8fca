"""The list of finished results of a batch, in its output folder: a second run paints only what is missing.

A result is known by its content: the bytes of its inputs, the frames, the look and the version of Impasto. Bytes are
hashed once; a file counts as unchanged while its size and time of change are the same.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from pipeline.errors import BadInput
from pipeline.video.numbering import is_pattern, number_by

NAME = ".impasto-batch.json"
_HASHED_BYTES = 1 << 20


@dataclass(frozen=True)
class Result:
    """A painted shot: its path in the output folder, and its version."""

    shot: str
    version: int
    output: str
    frames: int = 0


class Ledger:
    """Results by key, and hashes of files. Saved after each change, whole or not at all."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._path = folder / NAME
        stored: dict[str, Any] = {}
        with suppress(FileNotFoundError):
            try:
                stored = json.loads(self._path.read_text("utf-8"))
            except ValueError:
                raise BadInput(
                    "The record of this batch is damaged.", field="--output", value=self._path,
                    remedy="Delete that file: shots are painted again, as new versions.",
                ) from None  # fmt: skip
        self._results = {key: Result(**row) for key, row in stored.get("results", {}).items()}
        self._hashes: dict[str, list[Any]] = stored.get("hashes", {})

    def get(self, key: str) -> Result | None:
        """The result of this key, if its file is still there."""
        found = self._results.get(key)
        return found if found is not None and _exists(self.folder / found.output) else None

    def version_of(self, key: str, shot: str, taken: Any) -> int:
        """The version for a new result: that of the key if its file was deleted, else one more than the newest.

        Args:
            taken: version -> whether a file of it exists.
        """
        if (old := self._results.get(key)) is not None and not taken(old.version):
            return old.version
        version = 1 + max((row.version for row in self._results.values() if row.shot == shot), default=0)
        while taken(version):
            version += 1
        return version

    def add(self, key: str, result: Result) -> None:
        self._results[key] = result
        self.save()

    def save(self) -> None:
        rows = {key: asdict(result) for key, result in self._results.items()}
        part = self._path.with_name(f"{NAME}.part")
        self.folder.mkdir(parents=True, exist_ok=True)
        part.write_text(json.dumps({"results": rows, "hashes": self._hashes}, indent=1), "utf-8")
        part.replace(self._path)

    def content(self, path: Path) -> str:
        """A hash of a file, or of the files of a folder or pattern with their names. Raises BadInput."""
        files = _files(path)
        if not files:
            raise BadInput("File or folder not found.", field="source", value=path, remedy="Check the path.")
        if files == [path]:
            return self._hash(path)
        rows = [f"{file.name} {self._hash(file)}" for file in files]
        return hashlib.sha256("\n".join([path.name, *rows]).encode()).hexdigest()

    def _hash(self, path: Path) -> str:
        status = path.stat()
        known = self._hashes.get(str(path.resolve()))
        if known and known[:2] == [status.st_size, status.st_mtime_ns]:
            return str(known[2])
        with path.open("rb") as file:
            found = hashlib.file_digest(file, "sha256").hexdigest()
        self._hashes[str(path.resolve())] = [status.st_size, status.st_mtime_ns, found]
        return found


def _files(path: Path) -> list[Path]:
    if path.is_file():
        return [path]
    if path.is_dir():
        return sorted(p for p in path.rglob("*") if p.is_file() and not p.name.startswith("."))
    if is_pattern(path.name) and path.parent.is_dir():
        return sorted(p for p in path.parent.iterdir() if number_by(path.name, p.name) is not None)
    return []


def _exists(path: Path) -> bool:
    return any(path.iterdir()) if path.is_dir() else path.exists()


def key_of(facts: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(facts, sort_keys=True, default=str).encode()).hexdigest()
