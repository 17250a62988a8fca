"""The shots of a batch: where each comes from, and which frames of its source it has."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import Any

from impasto.ranges import SourceFacts, Span
from pipeline.errors import BadInput
from pipeline.formats import IMAGE_SUFFIXES
from pipeline.video.sequence_options import USUAL, SequenceOptions

MEDIA_SUFFIXES = frozenset({".mp4", ".m4v", ".mov", ".mkv", ".webm", ".avi", ".mxf", ".mpg", ".ts", ".gif", ".zip"})
"""Extensions of the films that a watched folder is searched for."""


@dataclass(frozen=True)
class Shot:
    """One shot. Names are unique in a batch."""

    name: str
    source: Path
    span: Span | None = None
    """Frames of the source; None: all."""
    tokens: Mapping[str, str] = field(default_factory=dict)
    """Values of the placeholders in output names: cut, event, clip, reel."""
    look: str = ""
    changes: Mapping[str, Any] = field(default_factory=dict)
    """Values of a look that a manifest gives for this shot alone."""
    handles: int | None = None
    rate: Fraction | None = None
    """Frames per second of numbered images; None: the usual ones."""
    notes: tuple[str, ...] = ()
    """Warnings about edits that are not painted: retimes, dissolves."""

    @property
    def sequence(self) -> SequenceOptions:
        """How its numbered images are read."""
        films = self.rate is None or self.source.is_file()
        return USUAL if films else SequenceOptions(fps=str(self.rate))

    def frames(self, facts: SourceFacts, handles: int) -> tuple[tuple[int, int] | None, tuple[str, ...]]:
        """[first, end) of the source with handles, and what was cut off because the source is shorter.

        Raises BadParameter: the span lies outside the source.
        """
        if self.span is None:
            return None, (("All frames of the source are painted: there are none for handles.",) if handles else ())
        first, end = self.span.resolve(facts, f"shot {self.name}")
        got = max(0, first - handles), min(facts.frames, end + handles)
        lacking = first - got[0], got[1] - end
        if min(lacking) == handles:
            return got, ()
        return got, (f"The source has {lacking[0]} and {lacking[1]} of {handles} frames of handles.",)


class Media:
    """Finds the files that a cut names, by name in folders."""

    def __init__(self, folders: Sequence[Path]) -> None:
        self._found: dict[str, Path] = {}
        for folder in folders:
            if not folder.is_dir():
                raise BadInput("There is no such folder.", field="media", value=folder, remedy="Check the path.")
            for path in sorted(folder.rglob("*")):
                for name in (path.name.lower(), path.stem.lower()):
                    self._found.setdefault(name, path)

    def find(self, names: Iterable[str], what: str) -> Path:
        """The first file that one of these names (or paths) means. Raises BadInput."""
        wanted = [name for name in names if name]
        for name in wanted:
            if (path := Path(name)).is_absolute() and path.exists():
                return path
        for name in wanted:
            base = Path(name).name.lower()
            if (found := self._found.get(base) or self._found.get(Path(base).stem)) is not None:
                return found
        raise BadInput(
            "The media of a shot was not found.", field=what, value=", ".join(wanted),
            remedy="Name the folder that it is in: --media FOLDER.",
        )  # fmt: skip


def unique(names: Sequence[tuple[str, str]]) -> list[str]:
    """Names of shots from (name, event): the event is added where a name occurs more than once."""
    count: dict[str, int] = {}
    for name, _event in names:
        count[name] = count.get(name, 0) + 1
    return [name if count[name] == 1 else f"{name}_{event}" for name, event in names]


def folder_shots(folder: Path) -> list[Shot]:
    """The films of a folder, in the order of their names."""
    files = [p for p in sorted(folder.iterdir()) if p.suffix.lower() in MEDIA_SUFFIXES and not p.name.startswith(".")]
    names = unique([(path.stem, path.suffix[1:]) for path in files])
    return [Shot(name, path, tokens={"cut": folder.resolve().name}) for name, path in zip(names, files, strict=True)]


def images_beside(folder: Path) -> list[str]:
    """Folders with images in the folder, which are no films: a manifest names them."""
    return [f"{p.name}/" for p in sorted(folder.iterdir()) if p.is_dir() and _has_images(p)]


def _has_images(folder: Path) -> bool:
    return any(p.suffix.lower() in IMAGE_SUFFIXES for p in folder.iterdir())


def rate_of(value: float) -> Fraction:
    """A frame rate as a fraction: 29.97 and 23.976 mean 30000/1001 and 24000/1001."""
    ntsc = Fraction(round(value * 1.001) * 1000, 1001)
    return (
        ntsc if abs(float(ntsc) - value) < 0.002 and value != round(value) else Fraction(value).limit_denominator(1001)
    )
