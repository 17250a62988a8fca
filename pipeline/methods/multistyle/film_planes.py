"""Regions and stroke directions of a frame as the film has them, from what its tasks save."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from pydantic import JsonValue

from pipeline.methods.base import Task
from pipeline.methods.multistyle.design import DirectionKey, keys_around
from pipeline.methods.multistyle.design_fields import moved
from pipeline.methods.multistyle.plan import design_of
from pipeline.methods.previews import FilmPlane, FilmPlaneKind, FilmTasks
from pipeline.tensors.ellipses import Ellipse
from pipeline.tensors.field import angle_of, strength_of


def film_plane(kind: FilmPlaneKind, number: int, film: FilmTasks) -> FilmPlane | None:
    """See `pipeline.methods.base.Method.film_plane`; None without regions."""
    return _directions(number, film) if kind == "directions" else _regions(number, film)


def _directions(number: int, film: FilmTasks) -> FilmPlane | None:
    task = _task(film, "paint", "analyze-", number)
    if task is None:
        return None
    at = min(number, task.args["stop"] - 1) - task.args["start"]
    arrays = film.load("paint", task.key, task.key)
    if f"{at}.field" not in arrays:
        arrays = film.load("paint", task.key, f"last-{task.key}")
    field = arrays[f"{at}.field"].astype(np.float32).transpose(2, 0, 1)
    plane = np.stack([angle_of(field), strength_of(field)], axis=-1).astype(np.float32)
    return FilmPlane(plane, moved=_moved(number, film, task))


def _moved(number: int, film: FilmTasks, task: Task) -> dict[str, JsonValue]:
    """Edge weight and elements of each region with directions: those of the key before, moved with the region; between
    two keys with the same patterns, their mean by the easing."""
    design = design_of(film.context, task.args["frames"])
    if design is None:
        return {}
    keyed = {(name, frame): Ellipse(*row) for name, frame, row in task.args.get("keyed", ())}
    now = {name: Ellipse(*rows[str(number)]) for name, rows in task.args.get("ellipses", {}).items()
           if str(number) in rows}  # fmt: skip
    out: dict[str, JsonValue] = {}
    for region in design.names:
        if (found := keys_around(design.directions, region, number)) is None:
            continue
        one, other, t = found
        rows = [_rows(key, keyed.get((region, key.frame)), now.get(region), film.context.size) for key in (one, other)]
        if [row["pattern"] for row in rows[0]] != [row["pattern"] for row in rows[1]]:
            t = 0.0
        elements = [_between(before, after, t) for before, after in zip(rows[0], rows[1 if t else 0], strict=True)]
        weight = round(one.edge_weight + t * (other.edge_weight - one.edge_weight), 4)
        out[region] = {"edge_weight": weight, "elements": list[JsonValue](elements)}
    return out


def _rows(key: DirectionKey, own: Ellipse | None, now: Ellipse | None, size: tuple[int, int]) -> list[dict[str, Any]]:
    """Elements as a design has them, where they are in this frame."""
    width, height = size
    rows = []
    for given in key.elements:
        at = moved(given, own, now if key.follow else None, size)
        reach = 1 / (at.decay_per_px * height) if at.decay_per_px else 0.0
        rows.append({
            "pattern": at.pattern, "at": [(at.x + 0.5) / width, (at.y + 0.5) / height],
            "angle": math.degrees(at.angle_rad), "reach": reach, "strength": at.strength,
        })  # fmt: skip
    return rows


def _between(one: Mapping[str, Any], other: Mapping[str, Any], t: float) -> dict[str, JsonValue]:
    """The element between two; angles change the shorter way round."""
    turn = (other["angle"] - one["angle"] + 180) % 360 - 180
    x, y = (a + t * (b - a) for a, b in zip(one["at"], other["at"], strict=True))
    reach = one["reach"] + t * (other["reach"] - one["reach"]) if one["reach"] and other["reach"] else one["reach"]
    return {
        "pattern": one["pattern"], "at": [round(min(max(value, -2), 3), 4) for value in (x, y)],
        "angle": round((one["angle"] + t * turn + 180) % 360 - 180, 2), "reach": round(min(reach, 100), 4),
        "strength": round(one["strength"] + t * (other["strength"] - one["strength"]), 4),
    }  # fmt: skip


def _regions(number: int, film: FilmTasks) -> FilmPlane | None:
    task = _task(film, "maps", "map-", number)
    if task is None:
        return None
    at = min(number, task.args["stop"] - 1) - task.args["start"]
    names = film.results("scan")["video"]["names"]
    return FilmPlane(film.load("maps", task.key, task.key)["maps"][at], tuple(names))


def _task(film: FilmTasks, step: str, stem: str, number: int) -> Task | None:
    """The task of a frame, or of the film's last frames; None if the step has none."""
    found = [task for key, task in film.tasks(step).items() if key.startswith(stem)]
    mine = (task for task in found if task.args["start"] <= number < task.args["stop"])
    return next(mine, max(found, key=lambda task: int(task.args["stop"]), default=None))
