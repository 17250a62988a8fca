"""Detection of damaged bytes. The key of an asset is the SHA-256 of its bytes, so that every reader can compare them.

A file is read in full once in each process, when it is first opened, and again when its inode, size or time of change
differs. So a seek in a large video costs nothing, and damage of a file that this process has already opened is found by
`impasto ops check --blobs`. Results and artefacts of jobs have no known hash and are not compared.
"""

from __future__ import annotations

import hashlib
import re
import threading
from collections import OrderedDict
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path

from workers.errors import DamagedBlob

_ASSET = re.compile(r"assets/([0-9a-f]{64})")
_MOST = 10_000
"""Number of files that a process remembers as undamaged."""
_State = tuple[int, int, int, int]

_lock = threading.Lock()
_intact: OrderedDict[_State, None] = OrderedDict()


def hash_of_key(key: str) -> str | None:
    """The SHA-256 that the bytes under this key have, in hex; None if it is not known."""
    found = _ASSET.fullmatch(key)
    return found and found[1]


def check_file(key: str, path: Path) -> None:
    """Raise DamagedBlob if the file has other bytes than its key names. Reads each state of a file once."""
    if (expected := hash_of_key(key)) is None:
        return
    state = _state(path)
    with _lock:
        if state in _intact:
            _intact.move_to_end(state)
            return
    with path.open("rb") as file:
        if hashlib.file_digest(file, "sha256").hexdigest() != expected:
            raise damaged(key)
    mark_intact(key, path, state)


def mark_intact(key: str, path: Path, state: _State | None = None) -> None:
    """Note that the file has the bytes that its key names: they have just been compared, or written."""
    if hash_of_key(key) is not None:
        with _lock, suppress(FileNotFoundError):  # somebody may have deleted it again
            _intact[state or _state(path)] = None
            while len(_intact) > _MOST:
                _intact.popitem(last=False)


def is_intact(key: str, pieces: Iterable[bytes]) -> bool:
    """Whether these are the bytes that the key names."""
    found = hashlib.sha256()
    for piece in pieces:
        found.update(piece)
    return found.hexdigest() == hash_of_key(key)


def compared(key: str, pieces: Iterable[bytes]) -> Iterator[bytes]:
    """The pieces. Raises DamagedBlob in place of the last one if they are not the bytes that the key names, so that a
    download of damaged bytes breaks off and is not taken for whole."""
    found, held = hashlib.sha256(), b""
    for piece in pieces:
        found.update(piece)
        if held:
            yield held
        held = piece
    if found.hexdigest() != hash_of_key(key):
        raise damaged(key)
    yield held


def damaged(key: str) -> DamagedBlob:
    """The error of a key whose bytes have changed."""
    return DamagedBlob(
        "The stored bytes of a file have changed: the disk has damaged them.", field="asset",
        value=f"ast_{hash_of_key(key)}",
        remedy="Upload the file again, which replaces them. Check the disk: `impasto ops check --blobs` finds others.",
    )  # fmt: skip


def _state(path: Path) -> _State:
    found = path.stat()
    return found.st_dev, found.st_ino, found.st_size, found.st_mtime_ns
