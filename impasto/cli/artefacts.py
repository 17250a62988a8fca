"""Artefacts beside a result: what the tasks of a job have each saved of one kind, put together as one file."""

from __future__ import annotations

import shutil
import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path

from impasto.cli.delivery import Target, beside, deliver
from workers.errors import NotFound
from workers.farm import Farm, Served
from workers.model import Job


def deliver_artefacts(
    farm: Farm, job: Job, where: Target, wanted: Mapping[str, Path | None], scratch: Path
) -> dict[str, str]:
    """Put every wanted artefact at its path, or beside the result: name -> path.

    An artefact is one file, or a zip of each task ("svg-run-0000000.zip", ...), which become one zip.
    """
    placed: dict[str, str] = {}
    for name, path in wanted.items():
        parts = [farm.file(job.id, file) for file in sorted(job.results) if _belongs(file, name)]
        if not parts:
            raise NotFound(f"The job has made no {name!r}.", field="--artefact", value=name, remedy="Leave it out.")
        suffix = Path(parts[0].filename).suffix
        at = (path.expanduser().absolute() if path else None) or beside(where, name + suffix)
        deliver(_whole(farm, parts, scratch / f"artefact-{name}{suffix}"), Target(at, "", "file"))
        placed[name] = str(at)
    return placed


def _belongs(file: str, artefact: str) -> bool:
    return file == artefact or file.startswith((f"{artefact}-", f"{artefact}."))


def _whole(farm: Farm, parts: list[Served], scratch: Path) -> Path | Iterator[bytes]:
    if len(parts) == 1 or not all(part.filename.endswith(".zip") for part in parts):
        return farm.read(parts[0])
    with zipfile.ZipFile(scratch, "w", zipfile.ZIP_DEFLATED) as whole:
        for part in parts:
            with farm.local(part) as path, zipfile.ZipFile(path) as archive:
                _add(whole, archive)
    return scratch


def _add(whole: zipfile.ZipFile, part: zipfile.ZipFile) -> None:
    """Copy every entry, with its own date and mode: the same parts make the same zip."""
    for entry in part.infolist():
        with part.open(entry) as source, whole.open(entry, "w") as sink:
            shutil.copyfileobj(source, sink, 1 << 20)
