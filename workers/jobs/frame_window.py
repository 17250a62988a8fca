"""The piece [start, stop) of a film that a job paints. Frame numbers are the film's everywhere: the piece only says
which frames are painted, so that everything with a time is evaluated at the film's time.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, get_args

from pydantic import JsonValue

from pipeline.colour.ocio import check_space, check_view
from pipeline.errors import BadParameter
from pipeline.methods.base import VideoInfo
from pipeline.video.media import Fields, SourceOptions
from workers.contract.request import Json

Span = tuple[int, int]
"""[first frame, one past the last)"""


def window_info(info: Json, frames: Span | None, source: SourceOptions | None = None) -> Json:
    """Facts of a video's asset for the piece: `frames` and `duration_s` are the piece's, `first` is the number of its
    first frame, `film` the frame count of the whole. None: unchanged.

    Args:
        source: which of the video streams is read.
    """
    if source is not None and source.picture is not None:
        info = {**info, **stream_info(info, source.picture)}
    if frames is None:
        return dict(info)
    count = max(0, min(frames[1], int(info.get("frames", 0)) or frames[1]) - frames[0])
    whole, seconds = int(info.get("frames", 0)), float(info.get("duration_s", 0.0))
    piece = {"frames": count, "duration_s": seconds * count / whole if whole else 0.0}
    return {**info, **piece, "first": frames[0], "film": whole}


def stream_info(info: Json, number: int) -> Json:
    """Facts of one video stream of an asset. Raises BadParameter: the asset has no such stream."""
    streams = info.get("streams") or [{}]
    if not 0 <= number < len(streams):
        count = "one video stream" if len(streams) == 1 else f"{len(streams)} video streams"
        raise BadParameter(
            f"The video has {count}.", field="source.picture", value=number, remedy=f"Use 0 to {len(streams) - 1}."
        )
    return dict(streams[number])


def check_source(source: SourceOptions, info: Json | None) -> None:
    """Check that the video has the chosen streams, and that fields are read in a known way. Raises BadParameter.

    Args:
        info: facts of its asset; None: unknown.
    """
    if source.fields not in get_args(Fields):
        remedy = f"Use one of: {', '.join(get_args(Fields))}."
        raise BadParameter("Order of fields not found.", field="source.fields", value=source.fields, remedy=remedy)
    check_space(source.colour, "source.colour")
    check_view(source.colour_view, "source.colour_view")
    if source.picture is not None and info is not None:
        stream_info(info, source.picture)
    count = None if info is None else info.get("sounds")
    for number in source.sound or ():
        if count is not None and not 0 <= number < count:
            remedy = f"Use 0 to {count - 1}." if count else "Leave it out."
            message = f"The video has {count or 'no'} sound {'track' if count == 1 else 'tracks'}."
            raise BadParameter(message, field="source.sound", value=number, remedy=remedy)


def window_inputs(
    info: Mapping[str, Json], frames: Span | None, source: SourceOptions | None = None
) -> dict[str, Json]:
    """Facts of a job's inputs by name; those of `video` are the piece's."""
    return {
        name: window_info(facts, frames, source) if name == "video" else dict(facts) for name, facts in info.items()
    }


def window_document(value: JsonValue, frames: Span | None) -> JsonValue:
    """A JSON document for frames that are painted as a video of their own, with frame numbers from `frames[0]`. Objects
    with a member `frame` in lists are keys: of those before the part only the latest of each region is kept, at its
    first frame. None: unchanged."""
    if frames is None:
        return value
    if isinstance(value, dict):
        return _members(value, frames)
    if isinstance(value, list | tuple):
        return _list_within(list(value), frames)
    return value


def _members(value: Json, frames: Span) -> dict[str, JsonValue]:
    return {name: window_document(member, frames) for name, member in value.items()}


def _list_within(items: list[Any], frames: Span) -> list[JsonValue]:
    start, stop = frames
    if not items or not all(isinstance(item, dict) and type(item.get("frame")) is int for item in items):
        return [window_document(item, frames) for item in items]
    latest: dict[object, int] = {}
    for item in items:
        if item["frame"] <= start:
            group = item.get("region")
            latest[group] = max(latest.get(group, 0), item["frame"])
    kept = [
        item for item in items
        if start < item["frame"] < stop or (item["frame"] <= start and item["frame"] == latest[item.get("region")])
    ]  # fmt: skip
    return [{**_members(item, frames), "frame": max(0, item["frame"] - start)} for item in kept]


def video_info(info: Json, lead: int = 0) -> VideoInfo:
    """Facts about a video for planning, from its asset's info.

    Args:
        lead: frames to paint before the piece: see `Params.lead_frames`.
    """
    frames, first = int(info.get("frames", 0)), int(info.get("first", 0))
    before, film = min(lead, first), int(info.get("film", 0))
    rate, seconds = float(info.get("fps", 0.0)), float(info.get("duration_s", 0.0))
    if before:
        seconds += before / rate if rate else 0.0
    width, height = int(info.get("width", 0)), int(info.get("height", 0))
    return VideoInfo(width, height, frames + before, rate, seconds, first - before, film, before)
