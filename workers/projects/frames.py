"""Frame numbers of a JSON document, moved to where a piece of a video begins.

Objects with a member `frame` in lists are keys. Those at or after the piece's end are left out. Of those before its
start, only the latest of each region is kept, at the piece's first frame.

Departure: a value that changes between a key before the start and one after it begins at the earlier key's value,
where the whole video would already have moved on. It matters only for the first frames of a piece.
"""

from __future__ import annotations

from typing import Any


def within(value: Any, frames: tuple[int, int] | None) -> Any:
    """The document for frames [start, stop) of the video, counted from 0. None: unchanged."""
    if frames is None:
        return value
    if isinstance(value, dict):
        return {name: within(member, frames) for name, member in value.items()}
    if isinstance(value, list | tuple):
        return _list_within(list(value), frames)
    return value


def _list_within(items: list[Any], frames: tuple[int, int]) -> list[Any]:
    start, stop = frames
    if not items or not all(isinstance(item, dict) and type(item.get("frame")) is int for item in items):
        return [within(item, frames) for item in items]
    latest: dict[Any, int] = {}
    for item in items:
        if item["frame"] <= start:
            group = item.get("region")
            latest[group] = max(latest.get(group, 0), item["frame"])
    kept = [
        item for item in items
        if start < item["frame"] < stop or (item["frame"] <= start and item["frame"] == latest[item.get("region")])
    ]  # fmt: skip
    return [{**within(item, frames), "frame": max(0, item["frame"] - start)} for item in kept]
