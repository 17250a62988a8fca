"""Steps "regions" and "maps": propagated label maps, tubes, and the region map of every frame.

Each task is a run of frames; see `plan` for the dependencies.
"""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Callable, Iterable, Mapping

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Arrays, State, part
from pipeline.errors import BadParameter
from pipeline.frames import Frame
from pipeline.methods.base import PlanContext, Task, TaskContext, TaskResult, VideoInfo
from pipeline.methods.given_motion import given_motion
from pipeline.methods.multistyle.design import REST, Design, followed
from pipeline.methods.multistyle.design_fields import RegionPlacement
from pipeline.methods.multistyle.label_propagation import RegionMap
from pipeline.methods.multistyle.params import MultistyleParams
from pipeline.methods.multistyle.passes import OF_REGIONS
from pipeline.methods.multistyle.regions import CORRECTIONS, MASKS, Propagated, RegionKeys, RegionPropagator, compose
from pipeline.methods.multistyle.tubes import Tube, TubeTracker, merge_results, tubes_of
from pipeline.methods.scan import shots_of
from pipeline.tensors.ellipses import Ellipse, fit_ellipse, track_ellipses
from pipeline.video.stills import encode_png
from pipeline.video.writer import zip_entry

ARTEFACT = "regions"
WEIGHT = 0.25
"""Cost of propagation and segmentation of a frame, relative to analysis and painting."""
Run = tuple[int, int, tuple[int, int]]
"""First frame, frame after the last, and (first frame, frame after the last) of the shot."""


def requirements(design: Design | None, context: TaskContext[MultistyleParams], frames: int) -> TaskResult:
    """Facts about the design that planning needs; a part of the result of the scan."""
    shown = context.wants(ARTEFACT) or any(map(context.wants_pass, OF_REGIONS))
    design = design or Design(version=1)
    keys = _region_keys(design, context)
    for number in keys.channels.get(MASKS, ()):
        if not 0 <= number < frames:
            raise BadParameter(
                f"The video has {frames} frames.", field=f"inputs.{MASKS}", value=number,
                remedy="Name each label map by its frame number.",
            )  # fmt: skip
    made = {name: [list(region.tubes), list(region.objects)] for name, region in design.regions.items()}
    return {
        "channels": keys.channels, "tubes": shown or design.wants_tubes, "made": made,
        "maps": shown or bool(set(design.regions) - {REST}), "names": list(design.names),
        "follow": [[name, frame] for name, frame in followed(design)],
    }  # fmt: skip


def span_of(facts: TaskResult, video: VideoInfo) -> tuple[int, int]:
    """Frames [first, end) of the film in which the regions of a piece are found: from the latest keyframe of each
    channel before it to the next one after it; tubes have the numbers of the whole film.

    Args:
        facts: as returned by `requirements`.
    """
    if not facts["maps"]:
        return video.first, video.stop
    if facts["tubes"]:
        return 0, video.total
    first, stop = video.first, video.stop
    for channel, keys in facts["channels"].items():
        if channel == CORRECTIONS:  # all of them hold in their shot
            first, stop = min(first, *keys), max(stop, *(key + 1 for key in keys))
        first = min(first, max((key for key in keys if key < video.first), default=first))
        stop = max(stop, min((key + 1 for key in keys if key >= video.stop), default=stop))
    return first, stop


def _region_keys(design: Design, context: TaskContext[MultistyleParams]) -> RegionKeys:
    return RegionKeys(design, context.images(MASKS) if design.wants_masks else {}, context.size)


# -- step "regions": forwards and backwards


def plan_regions(context: PlanContext[MultistyleParams], runs: list[Run]) -> list[Task]:
    facts = context.results["scan"]["video"]
    if not facts["maps"]:
        return []
    keys = [key for listed in facts["channels"].values() for key in listed]
    tasks: list[Task] = []
    for number, (start, stop, shot) in enumerate(runs):
        args = {"start": start, "stop": stop, "tubes": facts["tubes"], "shot": _shot_number(runs, shot)}
        args["frames"] = facts["film"]
        first, weight = start == shot[0], WEIGHT * (stop - start)
        after = () if first else (f"fore-{runs[number - 1][0]:07d}",)
        tasks.append(Task(f"fore-{start:07d}", args | {"last": stop == shot[1]}, after, weight=weight))
        if any(start + first <= key < shot[1] for key in keys):
            behind = (f"back-{stop:07d}",) if any(stop <= key < shot[1] for key in keys) else ()
            tasks.append(Task(f"back-{start:07d}", args | {"last": first}, behind, weight=weight))
    return tasks


def _shot_number(runs: list[Run], shot: tuple[int, int]) -> int:
    return sorted({run[2] for run in runs}).index(shot)


def run_regions(task: Task, context: TaskContext[MultistyleParams], design: Design | None) -> TaskResult:
    """Propagate label maps through one run, and track its tubes."""
    design = design or Design(version=1)
    forwards, motion = task.key.startswith("fore"), given_motion(context)
    propagator = RegionPropagator(_region_keys(design, context), motion, forwards)
    tubes = TubeTracker(context.size, task.args["shot"]) if forwards and task.args["tubes"] else None
    if task.after:
        state = context.load("regions", f"state-{task.after[0]}")
        propagator.restore(part(state, "propagator"))
        if tubes:
            tubes.restore(part(state, "tubes"))
    start, stop = task.args["start"], task.args["stop"]
    propagated: list[NDArray[np.uint8]] = []
    ids: list[NDArray[np.int64]] = []
    results: list[tuple[int, TaskResult]] = []
    for number, frame in _in_order(context, start, stop, forwards):
        with context.clock("propagate"):
            propagated.append(propagator.step(number, frame))
        if tubes:
            with context.clock("tubes"):
                found, result = tubes.step(frame, motion.flow(number - 1, number, tubes.size))
            ids.append(found)
            results.append((number, result))
        context.progress(len(propagated) / (stop - start))
    context.save(task.key, _packed(propagated if forwards else propagated[::-1], ids))
    if not task.args["last"]:
        state = {f"propagator.{name}": array for name, array in propagator.state().items()}
        context.save(
            f"state-{task.key}", state | ({f"tubes.{k}": v for k, v in tubes.state().items()} if tubes else {})
        )
    return merge_results(results)


def _in_order(
    context: TaskContext[MultistyleParams], start: int, stop: int, forwards: bool
) -> Iterable[tuple[int, Frame]]:
    if forwards:
        return enumerate(context.frames("video", start, stop), start)
    return reversed(list(enumerate(context.frames("video", start, stop), start)))


def _packed(propagated: list[NDArray[np.uint8]], ids: list[NDArray[np.int64]]) -> State:
    out: State = {"propagated": np.stack(propagated)}
    if ids:
        names, inverse = np.unique(np.stack(ids), return_inverse=True)
        out |= {"names": names, "tubes": inverse.reshape(len(ids), *ids[0].shape).astype(np.uint16)}
    return out


# -- step "maps"


def plan_maps(context: PlanContext[MultistyleParams], runs: list[Run]) -> list[Task]:
    facts = context.results["scan"]["video"]
    if not facts["maps"]:
        return []
    shots = sorted({run[2] for run in runs})
    found: list[Tube] = []
    if facts["tubes"]:
        results = [result for key, result in context.results["regions"].items() if key.startswith("fore")]
        found = tubes_of(results, shots, min(context.video.width, context.video.height), context.params.objects)
    _check_numbers(facts["made"], found)
    owner = {
        str(one): name for name, (numbers, objects) in facts["made"].items() for tube in found for one in tube.ids
        if tube.number in numbers or tube.object in objects
    }  # fmt: skip
    numbers = {str(one): tube.number for tube in found for one in tube.ids}
    backs = set(context.results["regions"])
    tasks = []
    for start, stop, shot in runs:
        args: TaskResult = {"start": start, "stop": stop, "shot": list(shot), "owner": owner, "numbers": numbers}
        args["frames"] = facts["film"]
        args["back"] = f"back-{start:07d}" in backs
        tasks.append(Task(f"map-{start:07d}", args, weight=0.03 * (stop - start)))
    listed = {
        "tubes": [_tube_row(tube) for tube in found],
        "names": facts["names"],
        "starts": [run[0] for run in runs],
    }
    listed["frames"] = facts["film"]
    return [*tasks, Task("list", listed, tuple(task.key for task in tasks), weight=0.1)]


def _check_numbers(made: Mapping[str, list[list[int]]], found: list[Tube]) -> None:
    """Check that every tube and object of the design exists."""
    there = ({tube.number for tube in found}, {tube.object for tube in found})
    for name, listed in made.items():
        for kind, numbers, known in zip(("tubes", "objects"), listed, there, strict=True):
            for index, number in enumerate(numbers):
                if number not in known:
                    raise BadParameter(
                        f"Unknown {kind[:-1]}.", field=f"inputs.design.regions.{name}.{kind}[{index}]",
                        value=number, remedy=f"Use 1 to {max(known, default=0)}, see the artefact 'regions'.",
                    )  # fmt: skip


def _tube_row(tube: Tube) -> TaskResult:
    lab = np.array([[tube.lab]], np.float32).round().astype(np.uint8)
    rgb = cv2.cvtColor(lab, cv2.COLOR_LAB2RGB)[0, 0].tolist()
    frames = tube.last - tube.first + 1
    return {
        "tube": tube.number, "object": tube.object, "first": tube.first, "last": tube.last, "colour": rgb,
        "area": round(tube.area / frames, 1), "motion": list(tube.motion),
    }  # fmt: skip


def run_maps(task: Task, context: TaskContext[MultistyleParams], design: Design | None) -> TaskResult:
    return _list(task, context) if task.key == "list" else _map(task, context, design or Design(version=1))


def _map(task: Task, context: TaskContext[MultistyleParams], design: Design) -> TaskResult:
    """Region map of every frame of a run, and the ellipse of every region in it."""
    start, stop = task.args["start"], task.args["stop"]
    keys = _region_keys(design, context)
    fore = context.load("regions", f"fore-{start:07d}")
    back = context.load("regions", f"back-{start:07d}")["propagated"] if task.args["back"] else None
    owner = {int(tube): name for tube, name in task.args["owner"].items()}
    shot = (task.args["shot"][0], task.args["shot"][1])
    maps, found = [], {}
    for k in range(len(fore["propagated"])):
        ids = fore["names"][fore["tubes"][k]] if "tubes" in fore else None
        made = compose(
            keys, Propagated(start + k, shot, fore["propagated"][k], None if back is None else back[k]), ids, owner
        )
        maps.append(made)
        found[str(start + k)] = _ellipses_of(made, len(design.names))
        context.progress((k + 1) / (stop - start))
    context.save(task.key, {"maps": np.stack(maps)})
    context.save(
        f"colours-{task.key}", {"sums": _colour_sums(maps, context.frames("video", start, stop), len(design.names))}
    )
    _emit_passes(context, start, maps, fore, task.args["numbers"])
    if context.wants(ARTEFACT):
        context.save_file(
            f"{ARTEFACT}-{start:07d}.zip", _png_archive(maps, fore, start, task.args["numbers"]), "application/zip"
        )
    return {"shapes": found}


def _ellipses_of(regions: RegionMap, count: int) -> dict[str, list[float]]:
    """Ellipse of each region of a map, by region number as text; angles in [0, pi)."""
    found = {number: fit_ellipse(np.asarray(regions == number, np.bool_)) for number in range(1, count)}
    return {str(k): [round(value, 4) for value in _row(own)] for k, own in found.items() if own is not None}


def _colour_sums(maps: list[NDArray[np.uint8]], frames: Iterable[Frame], count: int) -> NDArray[np.float64]:
    """Area, and sums of red, green and blue, of each frame and region: float64 (n, regions, 4)."""
    out = np.zeros((len(maps), count, 4))
    for own, found, frame in zip(out, maps, frames, strict=False):
        own[:, 0] = np.bincount(found.ravel(), minlength=count)
        for c in range(3):
            own[:, 1 + c] = np.bincount(found.ravel(), frame[..., c].ravel().astype(np.float64), count)
    return out


def _tube_numbers(fore: Arrays, numbers: Mapping[str, int]) -> NDArray[np.int64]:
    """Numbers of the tubes of a run by their index in its maps."""
    return np.array([numbers.get(str(name), 0) for name in fore.get("names", np.zeros(0))], np.int64)


def _emit_passes(
    context: TaskContext[MultistyleParams], start: int, maps: list[NDArray[np.uint8]], fore: Arrays,
    numbers: Mapping[str, int],
) -> None:  # fmt: skip
    rank = _tube_numbers(fore, numbers)
    wanted = [name for name in OF_REGIONS if context.wants_pass(name)]
    for k in range(len(maps) if wanted else 0):
        made = {"regions": maps[k], "tubes": rank[fore["tubes"][k]]}
        context.emit_passes(start + k, {name: made[name] for name in wanted})


def _png_archive(maps: list[NDArray[np.uint8]], fore: Arrays, start: int, numbers: Mapping[str, int]) -> bytes:
    """Zip of PNG files: `map-0000012.png`, region number as gray value; `tubes-0000012.png`, 65536 R + 256 G + B."""
    made = io.BytesIO()
    rank = _tube_numbers(fore, numbers)
    with zipfile.ZipFile(made, "w", zipfile.ZIP_STORED) as archive:
        for k, found in enumerate(maps):
            gray = cv2.imencode(".png", found)[1].tobytes()
            archive.writestr(zip_entry(f"map-{start + k:07d}.png"), gray)
            if "tubes" in fore:
                number = rank[fore["tubes"][k]]
                coded = np.dstack([number >> 16, number >> 8 & 255, number & 255]).astype(np.uint8)
                archive.writestr(zip_entry(f"tubes-{start + k:07d}.png"), encode_png(coded))
    return made.getvalue()


def _list(task: Task, context: TaskContext[MultistyleParams]) -> TaskResult:
    """Save the list of all regions, objects and tubes, with colour, area and lifetime."""
    if not context.wants(ARTEFACT):
        return {}
    sums = np.concatenate([context.load("maps", f"colours-map-{start:07d}")["sums"] for start in task.args["starts"]])
    regions = [_region_row(k, name, sums[:, k]) for k, name in enumerate(task.args["names"])]
    listed = {"version": 1, "regions": regions, "objects": _objects(task.args["tubes"]), "tubes": task.args["tubes"]}
    context.save_file(f"{ARTEFACT}-list.json", json.dumps(listed, indent=1).encode(), "application/json")
    return {}


def _region_row(number: int, name: str, sums: NDArray[np.float64]) -> TaskResult:
    """Row of the list; `sums` float64 (frames, 4): area and colour sums."""
    frames = np.flatnonzero(sums[:, 0])
    area = float(sums[:, 0].sum())
    colour = [round(float(v) / area) for v in sums[:, 1:].sum(axis=0)] if area else [0, 0, 0]
    span = [int(frames[0]), int(frames[-1])] if len(frames) else [0, -1]
    mean = round(area / len(frames), 1) if len(frames) else 0.0
    return {"number": number, "name": name, "first": span[0], "last": span[1], "colour": colour, "area": mean}


def _objects(tubes: list[TaskResult]) -> list[TaskResult]:
    out: dict[int, TaskResult] = {}
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


def expected_results(step: str, context: PlanContext[MultistyleParams]) -> Mapping[str, TaskResult] | None:
    """See `pipeline.methods.base.Method.expected_results`."""
    facts = context.results["scan"]["video"]
    if step == "regions":
        return None if facts["tubes"] else {}
    runs = [key.removeprefix("fore-") for key in context.results.get("regions", {}) if key.startswith("fore-")]
    return {f"map-{start}": {"shapes": {}} for start in runs} if step == "maps" else {}


# -- used by the step "paint"


def ellipses(context: PlanContext[MultistyleParams], start: int, stop: int, shot: tuple[int, int]) -> TaskResult:
    """Arguments of the analysis of a run: ellipses of the regions whose design elements follow them."""
    facts = context.results["scan"]["video"]
    if not facts["maps"] or not facts["follow"]:
        return {}
    found = {
        int(frame): own for key, result in context.results["maps"].items() if key != "list"
        for frame, own in result["shapes"].items()
    }  # fmt: skip
    now: dict[str, dict[str, list[float]]] = {}
    keyed: list[list[str | int | list[float]]] = []
    scan = context.results["scan"]["video"]
    shots = list(shots_of(context, scan))
    for name in sorted({region for region, _ in facts["follow"]}):
        number = str(facts["names"].index(name))
        for own in shots:
            tracked = track_ellipses({k: Ellipse(*found[k][number]) for k in range(*own) if number in found.get(k, {})})
            if own == shot:
                now[name] = {str(k): _row(tracked[k]) for k in range(start, stop) if k in tracked}
            keyed += [[name, k, _row(tracked[k])] for region, k in facts["follow"] if region == name and k in tracked]
    return {"ellipses": now, "keyed": keyed}


def _row(ellipse: Ellipse) -> list[float]:
    return [ellipse.x, ellipse.y, ellipse.angle_rad, ellipse.major_px, ellipse.minor_px]


def placed(
    design: Design | None, task: Task, context: TaskContext[MultistyleParams]
) -> Callable[[int], RegionPlacement | None]:
    """Function from frame number to the placement of the design's regions."""
    if design is None:
        return lambda number: None
    start = task.args["start"]
    maps: NDArray[np.uint8] | None = None
    if set(design.regions) - {REST}:
        maps = context.load("maps", f"map-{start:07d}")["maps"]
    empty = np.zeros(context.size[::-1], np.uint8)
    keyed = {(name, frame): Ellipse(*row) for name, frame, row in task.args.get("keyed", ())}
    tracks = task.args.get("ellipses", {})

    def at(number: int) -> RegionPlacement:
        now = {name: Ellipse(*rows[str(number)]) for name, rows in tracks.items() if str(number) in rows}
        return RegionPlacement(number, empty if maps is None else maps[number - start], now, keyed)

    return at
