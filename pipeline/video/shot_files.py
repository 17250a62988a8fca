"""Access to the files of a shot: an archive with folders of frames, passes and layers."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from itertools import takewhile
from pathlib import Path, PurePosixPath
from zipfile import ZipFile, ZipInfo

from pipeline.errors import UnreadableMedia
from pipeline.video.archive import MANIFEST, open_archive, options_in, read_entry
from pipeline.video.media import Limits
from pipeline.video.numbering import frame_numbers, frames_of, range_of, sequence_numbers
from pipeline.video.sequence_options import SequenceOptions

FRAMES, LAYERS = "frames", "layers"
PASSES = ("masks", "vectors", "normals", "ids", "lines", "directions", "keyframes", "painted", "guides", "style")
"""Folders that a shot or a layer may contain besides `frames`."""
SPARSE = frozenset({"keyframes", "painted"})
"""Folders that need no picture for every frame."""
Files = Mapping[str, bytes]
"""Path relative to the shot, separated by "/" -> contents, read on access."""


def root_of(names: Iterable[str]) -> str:
    """The common parent folder of all names: "shot/" for "shot/frames/1.png" and "shot/shot.json"."""
    folders = sorted(name.split("/")[:-1] for name in names)
    if not folders:
        return ""
    shared = takewhile(lambda pair: pair[0] == pair[1], zip(folders[0], folders[-1], strict=False))
    return "".join(f"{part}/" for part, _ in shared)


def is_shot(names: Iterable[str]) -> bool:
    """Whether these file names form a shot: a file shot.json, or a folder `frames` beside at least one other file."""
    listed = list(names)
    root = root_of(listed)
    below = [name[len(root) :] for name in listed]
    return MANIFEST in below or any(name.startswith(f"{FRAMES}/") for name in below)


def pictures_of(names: Iterable[str]) -> list[str]:
    """Names of those images of an archive that are the frames of its video, by name.

    Raises:
        UnreadableMedia: the archive is a shot without frames.
    """
    listed = sorted(names)
    if not is_shot(listed):
        return listed
    root = root_of(listed)
    found = [name for name in listed if name.startswith(f"{root}{FRAMES}/") and name.count("/") == root.count("/") + 1]
    if not found:
        raise UnreadableMedia(
            "The shot has no pictures.", field="file", value=f"{root}{FRAMES}/",
            remedy="Put the rendered frames of the whole picture, numbered, in a folder named frames.",
        )  # fmt: skip
    return found


class ShotFiles(Mapping[str, bytes]):
    """The files of a shot, or of a sequence, in a zip archive, read on access. The caller closes it.

    Of a sequence, only its frames are listed. A picture that is used again for a missing one has a name of its own.

    Attributes:
        options: how the frames are read.
        held: names of frames for which the one before is used.

    Raises: UnreadableMedia, MediaTooLarge.
    """

    def __init__(self, path: Path, limits: Limits | None = None) -> None:
        self._archive: ZipFile
        self._archive, members = open_archive(path, limits or Limits())
        listed = [*members, *(m for m in self._archive.infolist() if PurePosixPath(m.filename).name == MANIFEST)]
        root = root_of([m.filename for m in listed])
        self._members: dict[str, ZipInfo] = {m.filename[len(root) :]: m for m in listed}
        options = self.options = options_in(self._archive) or SequenceOptions()
        if not is_shot(self._members):
            self._members = _frames(self._members, options.missing, options.pattern, range_of(options.pattern))
        elif options.missing == "hold":
            self._members = _held(self._members)
        self.held = frozenset(name for name, member in self._members.items() if not member.filename.endswith(name))

    def __getitem__(self, name: str) -> bytes:
        return read_entry(self._archive, self._members[name])

    def __iter__(self) -> Iterator[str]:
        return iter(self._members)

    def __len__(self) -> int:
        return len(self._members)

    def close(self) -> None:
        self._archive.close()


def _of_frame(name: str) -> bool:
    """Whether a path names a file of one frame."""
    parts = PurePosixPath(name).parts
    inner = parts[2:] if parts[0] == LAYERS else parts
    return name != MANIFEST and (len(inner) == 1 or inner[0] != "style")


def _held(members: Mapping[str, ZipInfo]) -> dict[str, ZipInfo]:
    """The entries of a shot; in every pass, the picture before a missing one is used again."""
    folders: dict[PurePosixPath, dict[str, ZipInfo]] = {}
    for name, member in members.items():
        folders.setdefault(PurePosixPath(name).parent, {})[name] = member
    numbers = [number or 0 for number in frame_numbers(folders.get(PurePosixPath(FRAMES), ())).values()]
    found: dict[str, ZipInfo] = {}
    for folder, files in folders.items():
        whole = not numbers or folder.name in SPARSE or not _of_frame(next(iter(files)))
        found |= files if whole else _frames(files, "hold", "", (min(numbers), max(numbers)))
    return found


def _frames(
    members: Mapping[str, ZipInfo], missing: str, pattern: str, bounds: tuple[int, int] | None
) -> dict[str, ZipInfo]:
    """The entries of a sequence's frames; those of missing frames that are held are named by their numbers."""
    images = sequence_numbers(members, pattern)
    numbers = [number for number, _ in images if number is not None]
    if not numbers:
        return dict(members)
    frames, names = frames_of(numbers, missing, bounds), [name for _, name in images]
    found = {}
    for number, at in zip(frames.numbers, frames.shown, strict=True):
        path = PurePosixPath(names[at])
        held = numbers[at] != number
        found[str(path.with_name(f"{number:07d}{path.suffix}")) if held else names[at]] = members[names[at]]
    return found
