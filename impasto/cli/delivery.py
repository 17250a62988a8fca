"""Where a result goes: a video file, a still, a zip, or a folder of numbered frames; whole or not at all."""

from __future__ import annotations

import os
import re
import shutil
import zipfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from pipeline.errors import BadInput

FORMATS = {".mp4": "mp4", ".m4v": "mp4", ".webm": "webm", ".zip": "png", ".png": "png"}
FRAME_NAME = re.compile(r"\d{4,}\.png")


@dataclass(frozen=True)
class Target:
    """OUT, understood: the path, and the format a job must make for it."""

    path: Path
    format: str
    """Of OutputSpec: "mp4", "webm" or "png"."""
    kind: str
    """"file", "frames" (a folder) or "still" (one PNG)."""


def target(text: str) -> Target:
    """Understand OUT and find out now, not after an hour, whether it can be written.

    Raises: BadInput: unknown extension, no right to write, a folder that holds other things than frames.
    """
    path = Path(text).expanduser().absolute()
    if text.endswith(("/", "\\")) or path.is_dir():
        _check_folder(path)
        return Target(path, "png", "frames")
    suffix = path.suffix.lower()
    if suffix not in FORMATS:
        raise BadInput(
            "The extension of the output is not one that can be written.",
            field="--output",
            value=text,
            remedy=f"End it with {', '.join(sorted(FORMATS))}, or with / for a folder of PNG frames.",
        )
    _check_parent(path)
    return Target(path, FORMATS[suffix], "still" if suffix == ".png" else "file")


def _check_parent(path: Path) -> None:
    """Missing folders are made at the end; what matters now is that they can be."""
    there = next(folder for folder in path.parents if folder.exists())
    if not there.is_dir() or not os.access(there, os.W_OK | os.X_OK):
        raise BadInput(
            "The output cannot be written there.",
            field="--output",
            value=path,
            remedy=f"Check that {there} is a folder that you may write to.",
        )


def _check_folder(path: Path) -> None:
    _check_parent(path)
    if not path.exists():
        return
    if not path.is_dir():
        raise BadInput("A file has that name.", field="--output", value=path, remedy="Name another folder.")
    if other := next((p.name for p in path.iterdir() if not FRAME_NAME.fullmatch(p.name)), None):
        raise BadInput(
            f"The folder holds other things than numbered frames ({other}).",
            field="--output",
            value=path,
            remedy="Name a new folder: frames are never mixed with other files.",
        )


def deliver(result: Path | Iterable[bytes], where: Target) -> None:
    """Put the bytes of a result at `where`. Raises: OSError, BadInput (a still of several frames)."""
    where.path.parent.mkdir(parents=True, exist_ok=True)
    part = where.path.with_name(f".{where.path.name}.part")
    forget(part)
    try:
        if where.kind == "file":
            _write(result, part)
        else:
            _unpack(result, part, where)
        swap(part, where.path)
    finally:
        forget(part)


def beside(where: Target, filename: str) -> Path:
    """Where an artefact goes that was given no place: `cartoon.mp4` and "regions.zip" make `cartoon-regions.zip`."""
    return where.path.with_name(f"{where.path.stem}-{Path(filename).name}")


def _write(result: Path | Iterable[bytes], part: Path) -> None:
    if isinstance(result, Path):
        shutil.copyfile(result, part)
        return
    with part.open("wb") as file:
        file.writelines(result)


def _unpack(result: Path | Iterable[bytes], part: Path, where: Target) -> None:
    """Frames out of the zip of a "png" result: all into a folder, or the only one into a file."""
    archive = part.with_name(f"{part.name}.zip")
    try:
        _write(result, archive)
        with zipfile.ZipFile(archive) as frames:
            names = [name for name in frames.namelist() if FRAME_NAME.fullmatch(name)]
            if where.kind == "frames":
                part.mkdir()
                frames.extractall(part, names)
                return
            if len(names) != 1:
                raise _not_a_still(len(names), where.path)
            part.write_bytes(frames.read(names[0]))
    finally:
        archive.unlink(missing_ok=True)


def _not_a_still(count: int, path: Path) -> BadInput:
    return BadInput(
        f"The result has {count} frames, and a .png file holds one.",
        field="--output",
        value=path,
        remedy=f"Use {path.with_suffix('')}/ for numbered frames, or a .mp4 file.",
    )


def swap(part: Path, path: Path) -> None:
    """Rename `part` to `path`, replacing the file or the frames there."""
    if not path.is_dir():
        part.replace(path)
        return
    old = path.with_name(f".{path.name}.old")
    forget(old)
    path.rename(old)
    try:
        part.rename(path)
    except OSError:
        old.rename(path)
        raise
    forget(old)


def forget(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
