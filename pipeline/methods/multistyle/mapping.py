"""The steps that find regions: what is carried, which tubes there are, and the map of every frame.

Their tasks are runs of frames; see `plan` for how they hang together.
"""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.errors import BadParameter
from pipeline.frames import Frame
from pipeline.methods.abstraction.state import part
from pipeline.methods.base import Bench, Brief, Note, Task
from pipeline.methods.multistyle.design import REST, Design
from pipeline.methods.multistyle.designer import Placed
from pipeline.methods.multistyle.moments import followed, shapes
from pipeline.methods.multistyle.regions import MASKS, Given, Walk, compose
from pipeline.methods.multistyle.tubes import Tube, Tubes, add_up, tubes_of
from pipeline.tensors.ellipses import Ellipse
from pipeline.video.stills import encode_png
from pipeline.video.writer import zip_entry

__all__ = ["MASKS", "ellipses", "placed", "plan_maps", "plan_regions", "run_maps", "run_regions", "wishes"]

ARTEFACT = "regions"
FINDING = 0.25
"""What it costs to carry and segment a frame, where looking at it and painting it costs 1."""
Run = tuple[int, int, tuple[int, int]]


def wishes(design: Design | None, bench: Bench, frames: int) -> Note:
    """What planning must know of the design, for the note of the scan."""
    shown = bench.wants(ARTEFACT)
    design = design or Design(version=1)
    given = _given(design, bench)
    for number in given.channels.get(MASKS, ()):
        if not 0 <= number < frames:
            raise BadParameter(
                f"The video has {frames} frames.", field=f"inputs.{MASKS}", value=number,
                remedy="Number label maps by the frames that they are of.",
            )  # fmt: skip
    made = {name: [list(region.tubes), list(region.objects)] for name, region in design.regions.items()}
    return {
        "channels": given.channels, "tubes": shown or design.wants_tubes, "made": made,
        "maps": shown or bool(set(design.regions) - {REST}), "names": list(design.names),
        "follow": [[key.region, key.frame] for key in design.directions if key.elements and key.follow],
    }  # fmt: skip


def _given(design: Design, bench: Bench) -> Given:
    return Given(design, bench.images(MASKS) if design.wants_masks else {}, bench.size)


# -- regions: forwards and backwards


def plan_regions(brief: Brief, runs: list[Run]) -> list[Task]:
    wish = brief.notes["scan"]["video"]
    if not wish["maps"]:
        return []
    keys = [key for listed in wish["channels"].values() for key in listed]
    tasks: list[Task] = []
    for number, (start, stop, shot) in enumerate(runs):
        args = {"start": start, "stop": stop, "tubes": wish["tubes"], "shot": _shot_number(runs, shot)}
        args["frames"] = wish["frames"]
        first, weight = start == shot[0], FINDING * (stop - start)
        after = () if first else (f"fore-{runs[number - 1][0]:07d}",)
        tasks.append(Task(f"fore-{start:07d}", args | {"last": stop == shot[1]}, after, weight=weight))
        if any(start + first <= key < shot[1] for key in keys):
            behind = (f"back-{stop:07d}",) if any(stop <= key < shot[1] for key in keys) else ()
            tasks.append(Task(f"back-{start:07d}", args | {"last": first}, behind, weight=weight))
    return tasks


def _shot_number(runs: list[Run], shot: tuple[int, int]) -> int:
    return sorted({run[2] for run in runs}).index(shot)


def run_regions(task: Task, bench: Bench, design: Design | None) -> Note:
    """Carry through one run, and say what is known of its tubes."""
    design = design or Design(version=1)
    walk = Walk(_given(design, bench))
    forwards = task.key.startswith("fore")
    tubes = Tubes(bench.size, task.args["shot"]) if forwards and task.args["tubes"] else None
    if task.after:
        state = bench.load("regions", f"state-{task.after[0]}")
        walk.restore(part(state, "walk"))
        if tubes:
            tubes.restore(part(state, "tubes"))
    start, stop = task.args["start"], task.args["stop"]
    carried: list[NDArray[np.uint8]] = []
    ids: list[NDArray[np.int64]] = []
    notes: list[tuple[int, Note]] = []
    for number, frame in _in_order(bench, start, stop, forwards):
        with bench.clock("carry"):
            carried.append(walk.step(number, frame))
        if tubes:
            with bench.clock("tubes"):
                found, note = tubes.step(frame)
            ids.append(found)
            notes.append((number, note))
        bench.progress(len(carried) / (stop - start))
    bench.save(task.key, _kept(carried if forwards else carried[::-1], ids))
    if not task.args["last"]:
        state = {f"walk.{name}": array for name, array in walk.state().items()}
        bench.save(f"state-{task.key}", state | ({f"tubes.{k}": v for k, v in tubes.state().items()} if tubes else {}))
    return add_up(notes)


def _in_order(bench: Bench, start: int, stop: int, forwards: bool) -> Iterable[tuple[int, Frame]]:
    if forwards:
        return enumerate(bench.frames("video", start, stop), start)
    return reversed(list(enumerate(bench.frames("video", start, stop), start)))


def _kept(carried: list[NDArray[np.uint8]], ids: list[NDArray[np.int64]]) -> dict[str, NDArray[Any]]:
    out: dict[str, NDArray[Any]] = {"carried": np.stack(carried)}
    if ids:
        names, inverse = np.unique(np.stack(ids), return_inverse=True)
        out |= {"names": names, "tubes": inverse.reshape(len(ids), *ids[0].shape).astype(np.uint16)}
    return out


# -- maps


def plan_maps(brief: Brief, runs: list[Run]) -> list[Task]:
    wish = brief.notes["scan"]["video"]
    if not wish["maps"]:
        return []
    shots = sorted({run[2] for run in runs})
    found: list[Tube] = []
    if wish["tubes"]:
        notes = [note for key, note in brief.notes["regions"].items() if key.startswith("fore")]
        found = tubes_of(notes, shots, brief.video.height)
    _check_made(wish["made"], found)
    owner = {
        str(tube.id): name for name, (numbers, objects) in wish["made"].items() for tube in found
        if tube.number in numbers or tube.object in objects
    }  # fmt: skip
    numbers = {str(tube.id): tube.number for tube in found}
    backs = set(brief.notes["regions"])
    tasks = []
    for start, stop, shot in runs:
        args: Note = {"start": start, "stop": stop, "shot": list(shot), "owner": owner, "numbers": numbers}
        args["frames"] = wish["frames"]
        args["back"] = f"back-{start:07d}" in backs
        tasks.append(Task(f"map-{start:07d}", args, weight=0.03 * (stop - start)))
    listed = {"tubes": [_tube_row(tube) for tube in found], "names": wish["names"], "starts": [run[0] for run in runs]}
    listed["frames"] = wish["frames"]
    return [*tasks, Task("list", listed, tuple(task.key for task in tasks), weight=0.1)]


def _check_made(made: Mapping[str, list[list[int]]], found: list[Tube]) -> None:
    """Every tube and object that a design names is there."""
    there = ({tube.number for tube in found}, {tube.object for tube in found})
    for name, listed in made.items():
        for kind, numbers, known in zip(("tubes", "objects"), listed, there, strict=True):
            for index, number in enumerate(numbers):
                if number not in known:
                    raise BadParameter(
                        f"There is no such {kind[:-1]}.", field=f"inputs.design.regions.{name}.{kind}[{index}]",
                        value=number, remedy=f"There are 1 to {max(known, default=0)}: see the artefact 'regions'.",
                    )  # fmt: skip


def _tube_row(tube: Tube) -> Note:
    lab = np.array([[tube.lab]], np.float32).round().astype(np.uint8)
    rgb = cv2.cvtColor(lab, cv2.COLOR_LAB2RGB)[0, 0].tolist()
    life = tube.last - tube.first + 1
    return {
        "tube": tube.number, "object": tube.object, "first": tube.first, "last": tube.last, "colour": rgb,
        "area": round(tube.area / life, 1), "motion": list(tube.motion),
    }  # fmt: skip


def run_maps(task: Task, bench: Bench, design: Design | None) -> Note:
    return _list(task, bench) if task.key == "list" else _map(task, bench, design or Design(version=1))


def _map(task: Task, bench: Bench, design: Design) -> Note:
    """The region map of every frame of a run, and every region's ellipse in it."""
    start, stop = task.args["start"], task.args["stop"]
    given = _given(design, bench)
    fore = bench.load("regions", f"fore-{start:07d}")
    back = bench.load("regions", f"back-{start:07d}")["carried"] if task.args["back"] else None
    owner = {int(tube): name for tube, name in task.args["owner"].items()}
    shot = (task.args["shot"][0], task.args["shot"][1])
    maps, found = [], {}
    for k in range(len(fore["carried"])):
        ids = fore["names"][fore["tubes"][k]] if "tubes" in fore else None
        made = compose(given, start + k, shot, fore["carried"][k], None if back is None else back[k], ids, owner)
        maps.append(made)
        found[str(start + k)] = shapes(made, range(1, len(design.names)))
        bench.progress((k + 1) / (stop - start))
    bench.save(task.key, {"maps": np.stack(maps)})
    bench.save(f"about-{task.key}", {"sums": _about(maps, bench.frames("video", start, stop), len(design.names))})
    if bench.wants(ARTEFACT):
        bench.save_file(
            f"{ARTEFACT}-{start:07d}.zip", _pages(maps, fore, start, task.args["numbers"]), "application/zip"
        )
    return {"shapes": found}


def _about(maps: list[NDArray[np.uint8]], frames: Iterable[Frame], count: int) -> NDArray[np.float64]:
    """Of each frame and region, its area and the sums of red, green and blue over it: float64 (n, regions, 4)."""
    out = np.zeros((len(maps), count, 4))
    for own, found, frame in zip(out, maps, frames, strict=False):
        own[:, 0] = np.bincount(found.ravel(), minlength=count)
        for c in range(3):
            own[:, 1 + c] = np.bincount(found.ravel(), frame[..., c].ravel().astype(np.float64), count)
    return out


def _pages(
    maps: list[NDArray[np.uint8]], fore: Mapping[str, NDArray[Any]], start: int, numbers: Mapping[str, int]
) -> bytes:
    """PNG files: `map-0000012.png`, region numbers in gray; `tubes-0000012.png`, tube number = 65536 R + 256 G + B."""
    made = io.BytesIO()
    rank = np.array([numbers.get(str(name), 0) for name in fore.get("names", np.zeros(0))], np.int64)
    with zipfile.ZipFile(made, "w", zipfile.ZIP_STORED) as archive:
        for k, found in enumerate(maps):
            gray = cv2.imencode(".png", found)[1].tobytes()
            archive.writestr(zip_entry(f"map-{start + k:07d}.png"), gray)
            if "tubes" in fore:
                number = rank[fore["tubes"][k]]
                coded = np.dstack([number >> 16, number >> 8 & 255, number & 255]).astype(np.uint8)
                archive.writestr(zip_entry(f"tubes-{start + k:07d}.png"), encode_png(coded))
    return made.getvalue()


def _list(task: Task, bench: Bench) -> Note:
    """regions.json: every region, object and tube, with its colour, area and life."""
    if not bench.wants(ARTEFACT):
        return {}
    sums = np.concatenate([bench.load("maps", f"about-map-{start:07d}")["sums"] for start in task.args["starts"]])
    regions = [_region_row(k, name, sums[:, k]) for k, name in enumerate(task.args["names"])]
    listed = {"version": 1, "regions": regions, "objects": _objects(task.args["tubes"]), "tubes": task.args["tubes"]}
    bench.save_file(f"{ARTEFACT}-list.json", json.dumps(listed, indent=1).encode(), "application/json")
    return {}


def _region_row(number: int, name: str, sums: NDArray[np.float64]) -> Note:
    """`sums`: float64 (frames, 4)."""
    seen = np.flatnonzero(sums[:, 0])
    area = float(sums[:, 0].sum())
    colour = [round(float(v) / area) for v in sums[:, 1:].sum(axis=0)] if area else [0, 0, 0]
    life = [int(seen[0]), int(seen[-1])] if len(seen) else [0, -1]
    mean = round(area / len(seen), 1) if len(seen) else 0.0
    return {"number": number, "name": name, "first": life[0], "last": life[1], "colour": colour, "area": mean}


def _objects(tubes: list[Note]) -> list[Note]:
    out: dict[int, Note] = {}
    for tube in tubes:
        own = out.setdefault(
            tube["object"],
            {"object": tube["object"], "tubes": [], "first": tube["first"], "last": tube["last"], "sums": [0.0] * 4},
        )
        own["tubes"].append(tube["tube"])
        own["first"], own["last"] = min(own["first"], tube["first"]), max(own["last"], tube["last"])
        whole = tube["area"] * (tube["last"] - tube["first"] + 1)
        own["sums"] = [a + whole * b for a, b in zip(own["sums"], (1, *tube["colour"]), strict=True)]
    rows = []
    for number in sorted(out):
        own = out[number]
        whole, *colour = own.pop("sums")
        own |= {"area": round(whole / (own["last"] - own["first"] + 1), 1)}
        own |= {"colour": [round(value / max(whole, 1)) for value in colour]}
        rows.append(own)
    return rows


# -- for painting


def ellipses(brief: Brief, start: int, stop: int, shot: tuple[int, int]) -> Note:
    """Arguments of a run's `look`: the ellipses of the regions whose design elements follow them."""
    wish = brief.notes["scan"]["video"]
    if not wish["maps"] or not wish["follow"]:
        return {}
    found = {
        int(frame): own for key, note in brief.notes["maps"].items() if key != "list"
        for frame, own in note["shapes"].items()
    }  # fmt: skip
    now: dict[str, dict[str, list[float]]] = {}
    keyed: list[list[Any]] = []
    shots = sorted({run[2] for run in _runs(brief)})
    for name in sorted({region for region, _ in wish["follow"]}):
        number = str(wish["names"].index(name))
        for own in shots:
            tracked = followed({k: tuple(found[k][number]) for k in range(*own) if number in found.get(k, {})})
            if own == shot:
                now[name] = {str(k): _row(tracked[k]) for k in range(start, stop) if k in tracked}
            keyed += [[name, k, _row(tracked[k])] for region, k in wish["follow"] if region == name and k in tracked]
    return {"ellipses": now, "keyed": keyed}


def _runs(brief: Brief) -> list[Run]:
    from pipeline.methods.multistyle.plan import runs_of

    return list(runs_of(brief))


def _row(ellipse: Ellipse) -> list[float]:
    return [ellipse.x, ellipse.y, ellipse.angle_rad, ellipse.major_px, ellipse.minor_px]


def placed(design: Design | None, task: Task, bench: Bench) -> Callable[[int], Placed | None]:
    """Frame number -> where the design's regions are in it."""
    if design is None:
        return lambda number: None
    start = task.args["start"]
    maps: NDArray[np.uint8] | None = None
    if set(design.regions) - {REST}:
        maps = bench.load("maps", f"map-{start:07d}")["maps"]
    empty = np.zeros(bench.size[::-1], np.uint8)
    keyed = {(name, frame): Ellipse(*row) for name, frame, row in task.args.get("keyed", ())}
    tracks = task.args.get("ellipses", {})

    def at(number: int) -> Placed:
        now = {name: Ellipse(*rows[str(number)]) for name, rows in tracks.items() if str(number) in rows}
        return Placed(number, empty if maps is None else maps[number - start], now, keyed)

    return at
