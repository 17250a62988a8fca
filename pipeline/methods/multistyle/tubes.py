"""Tubes: regions that are coherent in space and time, and the objects that they make up.

The segmentation is the method abstraction's (zhang2011online, section 4), coarser. Departure: kagaya2011video takes
Brendel and Todorovic's, and says that any will do.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Frame
from pipeline.methods.abstraction.params import AbstractionParams
from pipeline.methods.abstraction.session import AbstractionSession
from pipeline.methods.abstraction.state import State
from pipeline.methods.base import Note

COARSE = AbstractionParams(
    growing_limit=26, core_tolerance=1.0, smallest_region=3, merge_similar=12, edge_threshold=140, lines="off",
    saliency_importance=0.2, motion_importance=0.2,
)  # fmt: skip
"""Fewer, larger regions than a cartoon has."""
OBJECTS = 8
"""Objects that tubes are merged to, in each shot."""
MOTION = 6.0
"""Lab units that a difference in motion of one px a frame counts as much as, for 360 rows."""


class Tubes:
    """Follows the tubes of one shot. Its state can be handed on."""

    def __init__(self, size: tuple[int, int], shot: int) -> None:
        self.session = AbstractionSession(COARSE, size, shot=shot)

    def step(self, frame: Frame) -> tuple[NDArray[np.int64], Note]:
        """The next frame's tubes: int64 (h, w), the id of each pixel's; and what is to be known of them."""
        seen = self.session.eye.step(frame)
        found = self.session.hand.step(seen).regions
        flow = None if seen.flow is None else seen.flow
        pixels = np.asarray(found.ids[found.labels], np.int64)
        return pixels, _note(found.labels, found.ids, found.areas, found.means, flow)

    def state(self) -> State:
        return self.session.state()

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        self.session.restore(state)


def _note(
    labels: NDArray[np.int32], ids: NDArray[np.int64], areas: NDArray[np.int32], means: NDArray[np.float32],
    flow: NDArray[np.float32] | None,
) -> Note:  # fmt: skip
    """JSON: of each tube, its area, and the sums of Lab and motion over it; of each pair that touches, how far."""
    count = len(ids)
    sums = np.zeros((count, 6), np.int64)
    sums[:, 0] = areas
    sums[:, 1:4] = np.rint(means * areas[:, None])
    if flow is not None:
        for c in range(2):
            moved = np.bincount(labels.ravel(), flow[..., c].ravel().astype(np.float64), count)
            sums[:, 4 + c] = np.rint(moved * 16)
    pairs = np.concatenate([_touching(labels[:, :-1], labels[:, 1:], count), _touching(labels[:-1], labels[1:], count)])
    codes, lengths = np.unique(pairs, return_counts=True)
    touch = {
        f"{ids[c // count]}-{ids[c % count]}": int(n) for c, n in zip(codes.tolist(), lengths.tolist(), strict=True)
    }
    return {"tubes": {str(ids[k]): sums[k].tolist() for k in range(1, count) if areas[k]}, "touch": touch}


def _touching(a: NDArray[np.int32], b: NDArray[np.int32], count: int) -> NDArray[np.int64]:
    differ = a != b
    one, other = a[differ].astype(np.int64), b[differ].astype(np.int64)
    return np.asarray(np.minimum(one, other) * count + np.maximum(one, other), np.int64)


@dataclass(frozen=True)
class Tube:
    """One tube over its life.

    Attributes:
        number: 1 and up, over the whole video, in the order of their ids.
        first, last: frames it is seen in.
        area: px, summed over its frames.
        lab: mean colour, 8-bit Lab; motion: mean, px a frame.
        object: number of the object that it belongs to, in its shot: 1 and up, the largest first.
    """

    id: int
    number: int
    first: int
    last: int
    area: int
    lab: tuple[float, float, float]
    motion: tuple[float, float]
    object: int


def add_up(notes: Iterable[tuple[int, Note]]) -> Note:
    """The notes of the frames of a run as one: tubes get their first and last frame in front."""
    tubes: dict[str, list[int]] = {}
    touch: dict[str, int] = defaultdict(int)
    for frame, note in notes:
        for tube, sums in note["tubes"].items():
            known = tubes.setdefault(tube, [frame, frame, 0, 0, 0, 0, 0, 0])
            known[1] = frame
            known[2:] = [a + b for a, b in zip(known[2:], sums, strict=True)]
        for pair, length in note["touch"].items():
            touch[pair] += length
    return {"tubes": tubes, "touch": dict(touch)}


def tubes_of(notes: Iterable[Note], shots: list[tuple[int, int]], rows: int) -> list[Tube]:
    """All tubes of a video, from the notes of its runs (`add_up`), each with the object that it is part of.

    Args:
        shots: (first frame, frame after the last) of each.
        rows: height of the frames, px.
    """
    sums: dict[int, list[int]] = {}
    touch: dict[tuple[int, int], int] = defaultdict(int)
    for note in notes:
        for name, own in note["tubes"].items():
            known = sums.setdefault(int(name), [own[0], own[1], 0, 0, 0, 0, 0, 0])
            known[0], known[1] = min(known[0], own[0]), max(known[1], own[1])
            known[2:] = [a + b for a, b in zip(known[2:], own[2:], strict=True)]
        for pair, length in note["touch"].items():
            one, _, other = pair.partition("-")
            touch[min(int(one), int(other)), max(int(one), int(other))] += length
    ids = sorted(sums)
    parts = _objects(ids, sums, touch, shots, rows)
    return [_tube(number, name, sums[name], parts[name]) for number, name in enumerate(ids, 1)]


def _tube(number: int, name: int, sums: list[int], part: int) -> Tube:
    area = max(sums[2], 1)
    light, a, b = (round(value / area, 2) for value in sums[3:6])
    x, y = (round(value / area / 16, 3) for value in sums[6:8])
    return Tube(name, number, sums[0], sums[1], sums[2], (light, a, b), (x, y), part)


def _objects(
    ids: list[int], sums: Mapping[int, list[int]], touch: Mapping[tuple[int, int], int],
    shots: list[tuple[int, int]], rows: int,
) -> dict[int, int]:  # fmt: skip
    """Tube -> object: in each shot, the pair that differs least for its size and border is merged, again and again.

    The cost is Ward's (area * area / sum * squared difference of colour and motion) for a unit of common border.
    """
    scale = MOTION * 360 / rows
    out: dict[int, int] = {}
    for start, stop in shots:
        mine = [name for name in ids if start <= sums[name][0] < stop]
        owner = _merged(mine, sums, touch, scale)
        area: dict[int, int] = defaultdict(int)
        for name, group in owner.items():
            area[group] += sums[name][2]
        rank = {group: k for k, group in enumerate(sorted(area, key=lambda group: (-area[group], group)), 1)}
        out |= {name: rank[group] for name, group in owner.items()}
    return out


def _merged(
    mine: list[int], sums: Mapping[int, list[int]], touch: Mapping[tuple[int, int], int], scale: float
) -> dict[int, int]:
    area = {name: float(max(sums[name][2], 1)) for name in mine}
    look = {
        name: np.array([*sums[name][3:6], *(v / 16 * scale for v in sums[name][6:8])], np.float64) / area[name]
        for name in mine
    }
    near: dict[int, dict[int, int]] = {name: {} for name in mine}
    for (one, other), length in touch.items():
        if one in near and other in near:
            near[one][other] = near[other][one] = length
    owner = {name: name for name in mine}

    def cost(one: int, other: int) -> float:
        apart = look[one] - look[other]
        weight = area[one] * area[other] / (area[one] + area[other])
        return float(weight * (apart @ apart + 4)) / near[one][other]

    costs = {(a, b): cost(a, b) for a in near for b in near[a] if a < b}
    while len(near) > OBJECTS and costs:
        a, b = min(costs, key=lambda pair: (costs[pair], pair))
        total = area[a] + area[b]
        look[a], area[a] = (look[a] * area[a] + look[b] * area[b]) / total, total
        for other, length in near.pop(b).items():
            near[other].pop(b)
            costs.pop((min(b, other), max(b, other)), None)
            if other != a:
                near[a][other] = near[other][a] = near[a].get(other, 0) + length
        for other in near[a]:
            costs[min(a, other), max(a, other)] = cost(a, other)
        for name, group in owner.items():
            if group == b:
                owner[name] = a
    return owner
