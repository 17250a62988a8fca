"""A file cache of pictures that Impasto paints for its own pages: exemplars of the style library, thumbnails of
methods.

They are in the user's cache folder, so that all services of a machine share them.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import tempfile
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path

import pipeline
from pipeline.compute.runtime import cache_folder

UNUSED_DAYS = 60
"""Days after which pictures that no service has used are deleted."""


def painted(name: str, facts: object, paint: Callable[[], bytes]) -> Path:
    """The file of a picture; painted if it does not exist.

    Args:
        name: name of the file, with its suffix.
        facts: values on which the picture depends besides the program; equal values must have equal `repr`.
        paint: makes the bytes of the file.
    """
    file = folder() / f"{hashlib.sha256(repr(facts).encode()).hexdigest()[:12]}-{name}"
    if not file.is_file():
        data = paint()
        with tempfile.NamedTemporaryFile(dir=file.parent, delete=False) as part:
            part.write(data)
        Path(part.name).replace(file)
    return file


@cache
def folder() -> Path:
    """The cache folder of this version of the program; its name is the hash of the program's files."""
    made = cache_folder() / "styles" / _program()
    made.mkdir(parents=True, exist_ok=True)
    os.utime(made)
    for other in made.parent.iterdir():
        if other.stat().st_mtime < time.time() - UNUSED_DAYS * 86_400:
            shutil.rmtree(other, ignore_errors=True)
    return made


def _program() -> str:
    """SHA-256 of the program that paints: every Python and OpenCL file of the pipeline."""
    digest = hashlib.sha256()
    root = Path(pipeline.__file__).parent
    for file in sorted(path for path in root.rglob("*") if path.suffix in (".py", ".cl")):
        digest.update(f"{file.relative_to(root)}\0".encode() + file.read_bytes())
    return digest.hexdigest()[:24]
