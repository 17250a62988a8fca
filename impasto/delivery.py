"""Output files: a video, a still, a zip, or a folder of numbered frames. Each appears whole or not at all."""

from __future__ import annotations

import errno
import shutil
import tempfile
import zipfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from pipeline.errors import BadInput, StorageError, StorageFull
from pipeline.formats import IN_FILM, OUTPUTS, PASS_FORMATS, output_format, output_of_suffix
from pipeline.formats.base import OutputFormat, Profile
from pipeline.video.media import MediaInfo
from pipeline.video.numbering import has_place, name_by, number_by
from workers.contract.request import OutputSpec

_ARCHIVE = ".zip"
_FRAMES = next(form for form in OUTPUTS.values() if form.frame_suffixes)
"""Format of numbered frames, if no other one is named."""


@dataclass(frozen=True)
class OutputTarget:
    """An output: its absolute path, and the format that a job must produce for it."""

    path: Path
    format: str
    """Name of the output format."""
    kind: str
    """"file", "frames" (a folder) or "still" (one frame)."""
    pattern: str = ""
    """Names of frames in a folder, "name.####.tif"."""


def target(text: str, field: str = "--output", form: str = "") -> OutputTarget:
    """Parse the name of an output, and check that it can be written.

    Args:
        text: a file name with an extension of an output format; a folder (an existing one, or with "/" at the end); or
            a folder and a pattern with a place for the frame number, "shot/name.####.tif".
        field: name of the option or argument, for errors.
        form: name of the format; "": the one of the extension, PNG for folders and zips.

    Raises: BadInput: an unknown extension, one of another format than `form`, a missing permission, a folder with files
    that are not frames.
    """
    path = expanded(Path(text)).absolute()
    wanted = output_format(form) if form else None
    if text.endswith(("/", "\\")) or path.is_dir():
        chosen = wanted or _FRAMES
        if not chosen.frame_suffixes:
            raise _other_format(text, field, chosen)
        return _folder(path, chosen, f"####{chosen.frame_suffixes[0]}", field)
    suffix = path.suffix.lower()
    found = (wanted, False) if wanted and suffix == _ARCHIVE and wanted.frame_suffixes else output_of_suffix(suffix)
    if found is None:
        known = sorted(suffix for each in OUTPUTS.values() for suffix in (*each.suffixes, *each.frame_suffixes))
        raise BadInput(
            "The extension of the output is unknown.",
            field=field,
            value=text,
            remedy=f"End it with {', '.join(known)}, or with / for a folder of numbered frames.",
        )
    made, is_frame = found
    if wanted is not None and made is not wanted:
        raise _other_format(text, field, wanted)
    if is_frame and has_place(path.name):
        return _folder(path.parent, made, path.name, field)
    _check_parent(path, field)
    return OutputTarget(path, made.name, "still" if is_frame else "file")


def passes_target(text: str, output: OutputSpec) -> OutputTarget | None:
    """The target of the passes of a job; None: beside its result.

    Args:
        text: a .zip; for passes in one image a frame also a folder, "DIR/" or "DIR/name.####.EXTENSION"; "": none.

    Raises: BadInput.
    """
    field = "--passes-to"
    if not text:
        return None
    if not output.passes:
        raise BadInput("No pass is asked for.", field=field, value=text, remedy="Name passes: --passes flow,labels.")
    if output.passes_format == IN_FILM:
        raise BadInput("The passes are in the film's images.", field=field, value=text, remedy="Leave it out.")
    if text.lower().endswith(_ARCHIVE):
        path = expanded(Path(text)).absolute()
        _check_parent(path, field)
        return OutputTarget(path, "", "file")
    if output.passes_format not in ("", PASS_FORMATS[0]):
        raise BadInput("Passes of this format are saved as one file.", field=field, value=text,
                       remedy=f"Name a {_ARCHIVE} file.")  # fmt: skip
    found = target(text, field, PASS_FORMATS[0])
    if found.kind == "still":
        raise BadInput("An image holds one frame.", field=field, value=text, remedy=f"Name a folder, or a {_ARCHIVE}.")
    return found


def _folder(path: Path, form: OutputFormat, pattern: str, field: str) -> OutputTarget:
    where = OutputTarget(path, form.name, "frames", pattern)
    _check_folder(where, field)
    return where


def _other_format(text: str, field: str, form: OutputFormat) -> BadInput:
    frames = f"Name a {_ARCHIVE} file, or a folder with / at the end."
    remedy = frames if form.frame_suffixes else f"End OUT with {' or '.join(form.suffixes)}."
    return BadInput(f"OUT does not fit the format {form.name}.", field=field, value=text, remedy=remedy)


def _check_parent(path: Path, field: str) -> None:
    """Create and delete a file in the nearest existing folder: missing folders are created at the end."""
    there = _existing_folder(path)
    try:
        with tempfile.TemporaryFile(dir=there) as file:
            file.write(b"x")
    except OSError as error:
        raise BadInput(
            f"The output cannot be written there: {error.strerror or error}.",
            field=field,
            value=path,
            remedy=f"Check that {there} is a folder that you may write to, on a disk with free space.",
        ) from None


def _existing_folder(path: Path) -> Path:
    return next(folder for folder in path.parents if folder.exists())


def expanded(path: Path) -> Path:
    """The path with "~" as the home folder, unless there is a file of that very name, or no such user."""
    if path.exists():
        return path
    try:
        return path.expanduser()
    except RuntimeError:
        return path


def same_file(one: Path, other: Path) -> bool:
    """Whether two paths name one file, also through links."""
    one, other = expanded(one), expanded(other)
    return one.resolve() == other.resolve() or (one.exists() and other.exists() and one.samefile(other))


def check_new(path: Path, overwrite: bool, field: str = "--output") -> None:
    """Raise BadInput if the output exists and may not be replaced; an empty folder is none."""
    if not overwrite and path.exists() and not (path.is_dir() and not any(path.iterdir())):
        raise BadInput("The output exists already.", field=field, value=path,
                       remedy="Add --overwrite to replace it, or name another file.")  # fmt: skip


def check_still(where: OutputTarget, frames: int) -> None:
    """Raise BadInput if a video of `frames` frames is to become a single image."""
    if where.kind == "still" and frames != 1:
        raise _not_a_still(frames, where.path)


def check_space(where: OutputTarget, info: MediaInfo, profile: Profile) -> None:
    """Raise StorageFull if the output's disk clearly lacks space for the result of a video.

    The estimate is low (`Profile.low_bytes_per_pixel`): a result that passes may still turn out larger.
    """
    require_extra = round(info.frames * info.width * info.height * profile.low_bytes_per_pixel)
    free = shutil.disk_usage(_existing_folder(where.path)).free
    if free < require_extra:
        raise StorageFull(
            f"The output's disk has {free >> 20} MiB free, and the result needs about {require_extra >> 20} MiB.",
            field="--output",
            value=where.path,
            remedy="Free some space, or name a file on another disk.",
        )


@contextmanager
def output_faults(field: str, path: Path) -> Iterator[None]:
    """Convert errors of the operating system while `path` is written to an error that names the path."""
    try:
        yield
    except OSError as error:
        full = error.errno in (errno.ENOSPC, errno.EDQUOT)
        kind = StorageFull if full else StorageError
        raise kind(
            f"The output cannot be written: {error.strerror or error}.",
            field=field,
            value=path,
            remedy="Free some space there, then run the same command again: it resumes."
            if full
            else "Check the folder, then run the same command again: it resumes.",
        ) from error


def _check_folder(where: OutputTarget, field: str) -> None:
    path = where.path
    _check_parent(path, field)
    if not path.exists():
        return
    if not path.is_dir():
        raise BadInput("A file has that name.", field=field, value=path, remedy="Name another folder.")
    if other := next((p.name for p in path.iterdir() if number_by(where.pattern, p.name) is None), None):
        raise BadInput(
            f"The folder contains files that are not numbered frames ({other}).",
            field=field,
            value=path,
            remedy="Name a new folder: frames are never mixed with other files.",
        )


def deliver(result: Path | Iterable[bytes], where: OutputTarget) -> None:
    """Write a result to `where`. Raises: OSError, BadInput (a still of several frames)."""
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


def beside(where: OutputTarget, filename: str) -> Path:
    """Default path of an artefact: beside `cartoon.mp4`, "labels.zip" becomes `cartoon-labels.zip`."""
    return where.path.with_name(f"{where.path.stem}-{Path(filename).name}")


def _write(result: Path | Iterable[bytes], part: Path) -> None:
    if isinstance(result, Path):
        shutil.copyfile(result, part)
        return
    with part.open("wb") as file:
        file.writelines(result)


def _unpack(result: Path | Iterable[bytes], part: Path, where: OutputTarget) -> None:
    """Extract frames from the zip of a result: all into a folder, or the only one into a file."""
    archive = part.with_name(f"{part.name}.zip")
    try:
        _write(result, archive)
        with zipfile.ZipFile(archive) as frames:
            stored = f"####{OUTPUTS[where.format].frame_suffixes[0]}"
            found = {name: at for name in frames.namelist() if (at := number_by(stored, name)) is not None}
            if where.kind == "frames":
                part.mkdir()
                for name, number in found.items():
                    part.joinpath(name_by(where.pattern, number)).write_bytes(frames.read(name))
                return
            if len(found) != 1:
                raise _not_a_still(len(found), where.path)
            part.write_bytes(frames.read(next(iter(found))))
    finally:
        archive.unlink(missing_ok=True)


def _not_a_still(count: int, path: Path) -> BadInput:
    return BadInput(
        f"The result has {count} frames, and a {path.suffix} file holds one.",
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
