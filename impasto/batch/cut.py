"""Cuts of an editor as shots: OpenTimelineIO, EDL (CMX 3600), FCPXML and FCP 7 XML, read by OpenTimelineIO."""

from __future__ import annotations

import importlib
from fractions import Fraction
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

from impasto.batch.shots import Media, Shot, rate_of, unique
from impasto.ranges import Span
from pipeline.errors import BadInput, BadParameter
from workers.extras import require_extra

SUFFIXES = frozenset({".otio", ".edl", ".fcpxml", ".xml"})


def cut_shots(path: Path, media: Media, fps: float | None = None) -> list[Shot]:
    """The shots of a cut in the order of the record side, of all video tracks.

    Args:
        fps: frame rate of an EDL, which names none itself.

    Raises: BadInput, BadParameter (an EDL without a frame rate; OpenTimelineIO is not installed).
    """
    require_extra("cuts", "cut", path.name)
    otio: Any = importlib.import_module("opentimelineio")
    options = {} if path.suffix.lower() != ".edl" else {"rate": float(rate_of(_edl_rate(path, fps)))}
    try:
        found = otio.adapters.read_from_file(str(path), **options)
    except Exception as error:  # adapters raise errors of every kind
        raise BadInput(
            f"The cut cannot be read: {error}.", field="cut", value=path, remedy="Export it again, best as OTIO."
        ) from error
    timelines = (
        [found] if hasattr(found, "tracks") else list(found.find_children(descended_from_type=otio.schema.Timeline))
    )
    clips = [clip for line in timelines for track in line.video_tracks() for clip in track.find_clips()]
    events = [f"{number:03d}" for number in range(1, len(clips) + 1)]
    names = unique([(_shot_name(clip), event) for clip, event in zip(clips, events, strict=True)])
    made = [_shot(otio, clip, name, event, path, media) for clip, name, event in zip(clips, names, events, strict=True)]
    if not made:
        raise BadInput("The cut has no clips.", field="cut", value=path, remedy="Check that it has a video track.")
    return made


def _edl_rate(path: Path, fps: float | None) -> float:
    if fps is None:
        raise BadParameter(
            "An EDL does not name its frame rate.", field="--fps", value=path, remedy="Give it: --fps 25."
        )
    return fps


def _shot_name(clip: Any) -> str:
    return Path(clip.name or "shot").stem.replace("/", "_")


def _shot(otio: Any, clip: Any, name: str, event: str, cut: Path, media: Media) -> Shot:
    reel = str(clip.metadata.get("cmx_3600", {}).get("reel", ""))
    url = str(getattr(clip.media_reference, "target_url", "") or "")
    local = unquote(urlsplit(url).path) if url.startswith("file:") else url
    if local and not Path(local).is_absolute():
        local = str((cut.parent / local).resolve())
    source = media.find([local, clip.name, reel], f"event {event}")
    available = clip.media_reference.available_range if clip.media_reference else None
    span, notes = _span(otio, clip)
    if available is not None:
        span = Span(span.first, span.end, span.kind, starts_s=_seconds(available.start_time))
    tokens = {"cut": cut.stem, "event": event, "clip": Path(clip.name or source.stem).stem, "reel": reel or "none"}
    return Shot(name, source, span, tokens, rate=_rate(clip.trimmed_range()), notes=notes)


def _span(otio: Any, clip: Any) -> tuple[Span, tuple[str, ...]]:
    """The frames of the source that a clip shows, with those of its dissolves; a retime is not painted."""
    trimmed, notes = clip.trimmed_range(), []
    first, length = _seconds(trimmed.start_time), _seconds(trimmed.duration)
    for effect in clip.effects:
        if isinstance(effect, otio.schema.LinearTimeWarp):
            length = max(length * abs(Fraction(effect.time_scalar).limit_denominator(1000)), 1 / _rate(trimmed))
            notes.append(
                f"Its speed of {effect.time_scalar:g} is left to the edit: the frames of the source are painted."
            )
    before, after = clip.parent().neighbors_of(clip)
    transition = otio.schema.Transition
    head = _seconds(before.in_offset) if isinstance(before, transition) else Fraction(0)
    tail = _seconds(after.out_offset) if isinstance(after, transition) else Fraction(0)
    return Span(max(Fraction(0), first - head), first + length + tail, "seconds"), tuple(notes)


def _rate(times: Any) -> Fraction:
    return rate_of(times.start_time.rate)


def _seconds(time: Any) -> Fraction:
    return Fraction(time.value).limit_denominator(1000) / rate_of(time.rate)
