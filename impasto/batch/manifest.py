"""A manifest as shots: a CSV file with a heading, or a JSON list of objects."""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from impasto.batch.looks import Look
from impasto.batch.shots import Media, Shot, rate_of, unique
from impasto.ranges import span_of
from pipeline.errors import BadInput, BadParameter, did_you_mean

SUFFIXES = frozenset({".csv", ".json"})
_OWN = ("source", "shot", "frames", "look", "handles", "reel")
_LOOK = tuple(name for name in Look.model_fields if name not in ("params", "inputs"))


def manifest_shots(path: Path, media: Media, fps: float | None = None) -> list[Shot]:
    """The shots of a manifest. Columns or fields: source, shot, frames, look, handles, reel; of a look: method, seed,
    quality, profile, alpha, on_damage; `params.NAME` and `inputs.NAME` (in JSON also objects `params` and `inputs`).

    Args:
        fps: frame rate of numbered images.

    Raises: BadInput, BadParameter that names the row.
    """
    rate = None if fps is None else rate_of(fps)
    rows = _csv(path) if path.suffix.lower() == ".csv" else _json(path)
    if not rows:
        raise BadInput("The manifest is empty.", field="manifest", value=path, remedy="Give a row for each shot.")
    found = [_row(row, f"row {number}", path, media) for number, row in enumerate(rows, 1)]
    names = unique([(shot.name, shot.tokens["event"]) for shot in found])
    return [Shot(**vars(shot) | {"name": name, "rate": rate}) for shot, name in zip(found, names, strict=True)]


def _csv(path: Path) -> list[dict[str, Any]]:
    with path.open(newline="", encoding="utf-8-sig") as file:
        rows = [{k: v for k, v in row.items() if v not in ("", None)} for row in csv.DictReader(file)]
    for number, row in enumerate(rows, 1):
        if None in row:
            raise BadParameter("The row has more cells than the heading.", field=f"row {number}", value=row[None],
                               remedy='Quote cells that contain commas: "a, b".')  # fmt: skip
    return rows


def _json(path: Path) -> list[dict[str, Any]]:
    try:
        rows = json.loads(path.read_text("utf-8-sig"))
    except ValueError as error:
        raise BadInput(f"It is no JSON: {error}.", field="manifest", value=path, remedy="Correct the file.") from None
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise BadInput(
            "It is no list of objects.", field="manifest", value=path, remedy='Write [{"source": ...}, ...].'
        )
    return rows


def _row(row: Mapping[str, Any], where: str, path: Path, media: Media) -> Shot:
    changes = _changes(row, where)
    if not row.get("source"):
        raise BadParameter("It names no source.", field=where, remedy="Give the column or field `source`.")
    given = str(row["source"])
    beside = path.parent / given
    source = beside if beside.exists() or "#" in given or "%" in given else media.find([given], where)
    tokens = {"cut": path.stem, "event": f"{int(where.split()[1]):03d}", "clip": source.stem,
              "reel": str(row.get("reel", "none"))}  # fmt: skip
    handles = row.get("handles")
    if handles is not None and not str(handles).isdecimal():
        raise BadParameter("Handles are a number of frames.", field=where, value=handles, remedy="For example 8.")
    return Shot(
        str(row.get("shot") or source.stem.split(".")[0]), source, span_of(str(row.get("frames", "")), where), tokens,
        str(row.get("look", "")), changes, None if handles is None else int(handles),
    )  # fmt: skip


def _changes(row: Mapping[str, Any], where: str) -> dict[str, Any]:
    """The values of a look in a row."""
    found: dict[str, Any] = {}
    for name, value in row.items():
        table, dot, entry = name.partition(".")
        if table in ("params", "inputs") and (dot or isinstance(value, dict)):
            found.setdefault(table, {}).update({entry: _value(value)} if dot else value)
        elif name in _LOOK:
            found[name] = value
        elif name not in _OWN:
            known = (*_OWN, *_LOOK, "params.NAME", "inputs.NAME")
            raise BadParameter("The column is unknown.", field=where, value=name,
                               remedy=did_you_mean(name, known, "columns"))  # fmt: skip
    return found


def _value(value: Any) -> Any:
    """A cell of a CSV file: JSON if it is, else text."""
    try:
        return json.loads(value) if isinstance(value, str) else value
    except ValueError:
        return value
