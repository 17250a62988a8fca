"""Whether the films of shots can be joined, and what happens to shots that differ in size or frame rate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from pipeline.formats.base import OutputFormat, Profile
from workers.contract.record import Asset
from workers.projects.document import Document, Shot

_MOST_NAMED = 3


@dataclass(frozen=True)
class Chapter:
    """Where a shot is in the film: its first frame, of its clip, is at the second `start_s`."""

    shot: str
    name: str
    first: int
    frames: int
    fps: float
    start_s: float


@dataclass(frozen=True)
class ShotClip:
    """Facts of a shot's clip that decide how its film is joined with others."""

    shot: str
    name: str
    width: int
    height: int
    fps: float
    first: int
    frames: int

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, px."""
        return self.width, self.height

    @staticmethod
    def of(number: int, shot: Shot, document: Document, assets: Mapping[str, Asset]) -> ShotClip:
        """`number`: of the shot, from 1; `assets`: by id, with the shot's clip."""
        info = assets[document.assets[shot.video].id].info
        first, end = shot.range or (0, info["frames"])
        fps = float(info.get("fps") or 0)
        name = shot.name or f"Shot {number}"
        return ShotClip(shot.id, name, info["width"], info["height"], fps, first, min(end, info["frames"]) - first)


def joins(form: OutputFormat) -> bool:
    """Whether films in this format can be joined: not numbered frames, and not formats that join frames themselves."""
    return not form.frame_suffixes and form.join is None


def chapters(clips: Sequence[ShotClip]) -> tuple[Chapter, ...]:
    """The shots of a film with their times. Where the frames of a clip have different durations, times are those of its
    mean frame rate."""
    found, start_s = [], 0.0
    for clip in clips:
        found.append(Chapter(clip.shot, clip.name, clip.first, clip.frames, clip.fps, round(start_s, 6)))
        start_s += clip.frames / clip.fps if clip.fps else 0.0
    return tuple(found)


def loses(profile: Profile) -> bool:
    """Whether films in this profile would lose by another encoding: they are joined as they are, or not at all."""
    return profile.is_deep or profile.has_alpha


def joining_notes(clips: Sequence[ShotClip], profile: Profile) -> tuple[str, ...]:
    """What is decided for clips that differ from the first one, in sentences; none if all are alike."""
    first, *others = clips
    sizes = [f"{one.name} ({one.width}x{one.height})" for one in others if one.size != first.size]
    rates = [f"{one.name} ({one.fps:.5g})" for one in others if abs(one.fps - first.fps) > 1e-3]
    notes = []
    if sizes:
        notes.append(
            f"The film has the size of its first shot, {first.width}x{first.height} px: {_named(sizes)} "
            f"{'is' if len(sizes) == 1 else 'are'} scaled into it, with black borders where the shape differs."
        )
    if rates:
        notes.append(
            f"{_named(rates)} {'keeps its' if len(rates) == 1 else 'keep their'} own frame rate; the first shot has "
            f"{first.fps:.5g} frames/s."
        )
    if notes and loses(profile):
        return (*notes, f"So the shots cannot be joined in {profile.title}, which would lose by another encoding.")
    return (*notes, "All shots are encoded once more to be joined.") if notes else ()


def _named(names: Sequence[str]) -> str:
    more = len(names) - _MOST_NAMED
    return ", ".join(names[:_MOST_NAMED]) + (f" and {more} more" if more > 0 else "")
