"""The files of a shot: an archive with folders of pictures, passes and layers. See `pipeline.video.shot`."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path, PurePosixPath
from zipfile import ZipFile, ZipInfo

from pipeline.errors import UnreadableMedia
from pipeline.video.archive import MANIFEST, natural_key, open_archive, read_entry
from pipeline.video.media import Limits

FRAMES, LAYERS = "frames", "layers"
PASSES = ("masks", "vectors", "normals", "ids", "lines", "keyframes", "painted", "guides", "style")
"""Folders of a shot or of a layer besides its frames."""
Files = Mapping[str, bytes]
"""Paths below the shot, with / between folders -> contents, read when asked for."""


def root_of(names: Iterable[str]) -> str:
    """The folders that all names share and that say nothing: "shot/" of "shot/frames/1.png" and "shot/shot.json"."""
    folders = [PurePosixPath(name).parts[:-1] for name in names]
    shared = 0
    while folders and all(len(f) > shared and f[shared] == folders[0][shared] for f in folders):
        shared += 1
    return "".join(f"{part}/" for part in folders[0][:shared]) if folders else ""


def is_shot(names: Iterable[str]) -> bool:
    """Whether files with these names are a shot, not plain numbered images: it has `frames` beside something else."""
    listed = list(names)
    below = [name[len(root_of(listed)) :] for name in listed]
    return MANIFEST in below or any(PurePosixPath(name).parts[0] == FRAMES and "/" in name for name in below)


def pictures_of(names: Iterable[str]) -> list[str]:
    """Which of an archive's images are the frames of its video, in order.

    Raises:
        UnreadableMedia: a shot without any.
    """
    listed = sorted(names, key=natural_key)
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
    """The files of a shot in a zip. Close it.

    Raises: UnreadableMedia, MediaTooLarge.
    """

    def __init__(self, path: Path, limits: Limits | None = None) -> None:
        self._archive: ZipFile
        self._archive, members = open_archive(path, limits or Limits())
        listed = [*members, *(m for m in self._archive.infolist() if PurePosixPath(m.filename).name == MANIFEST)]
        root = root_of([m.filename for m in listed])
        self._members: dict[str, ZipInfo] = {m.filename[len(root) :]: m for m in listed}

    def __getitem__(self, name: str) -> bytes:
        return read_entry(self._archive, self._members[name])

    def __iter__(self) -> Iterator[str]:
        return iter(self._members)

    def __len__(self) -> int:
        return len(self._members)

    def close(self) -> None:
        self._archive.close()
