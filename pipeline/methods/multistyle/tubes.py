"""Tubes, which are regions coherent in space and time, and the objects that tubes are merged to.

The segmentation is that of the method abstraction (zhang2011online, section 4) with coarser parameters. Departure:
kagaya2011video uses the segmentation of Brendel and Todorovic, and notes that any video segmentation can be used.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import JsonValue

from pipeline.arrays import Arrays, State
from pipeline.frames import Flow, Frame
from pipeline.methods.base import TaskResult

COARSE: Mapping[str, float | str] = MappingProxyType({
    "growing_limit": 26, "core_tolerance": 1.0, "smallest_region": 3, "merge_similar": 12, "edge_threshold": 140,
    "lines": "off", "saliency_importance": 0.2, "motion_importance": 0.2, "edges": "soft",
    "contrast_adaptation": 0,
})  # fmt: skip
"""Parameters of the method abstraction for fewer and larger regions than in a cartoon. With soft edges, frames are
analysed at their own size."""
MOTION = 6.0
"""Lab units equivalent to a difference in motion of one px a frame, for frames with a shorter side of 360 px."""


GAP_FRAMES, GAP_LAB, GAP_DISTANCE, GAP_GROWTH = 30, 12.0, 0.2, 3.0
"""Limits for a tube that continues an earlier one after an occlusion: frames between them, difference of mean colour
(8-bit Lab), distance from the extrapolated position as a fraction of the frame's shorter side, ratio of areas."""
LEAST_AREA = 0.0005
"""Area, as a fraction of the squared shorter side, below which tubes are not matched across occlusions."""


class TubeTracker:
    """Tracks the tubes of one shot."""

    def __init__(self, size: tuple[int, int], shot: int) -> None:
        # Imported here, because most paintings have no regions, and these imports take a tenth of the start.
        from pipeline.methods.abstraction.params import AbstractionParams
        from pipeline.methods.abstraction.session import AbstractionSession

        self.session = AbstractionSession(AbstractionParams.model_validate(COARSE), size, shot=shot)

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of given flows, px."""
        return self.session.sizes.work

    def step(self, frame: Frame, given: Flow | None = None) -> tuple[NDArray[np.int64], TaskResult]:
        """Segment the next frame: tube id of each pixel, int64 (h, w), and the statistics of the tubes.

        Args:
            given: flow from the previous frame; None: it is estimated.
        """
        analysis = self.session.analyzer.step(frame, None, given)
        found = self.session.regions.step(analysis).regions
        pixels = np.asarray(found.ids[found.labels], np.int64)
        return pixels, _statistics(found.labels, found.ids, found.areas, found.means, analysis.flow)

    def state(self) -> State:
        return self.session.state()

    def restore(self, state: Arrays) -> None:
        self.session.restore(state)


def _statistics(
    labels: NDArray[np.int32], ids: NDArray[np.int64], areas: NDArray[np.int32], means: NDArray[np.float32],
    flow: NDArray[np.float32] | None,
) -> TaskResult:  # fmt: skip
    """JSON: [area, sums of Lab and of motion * 16] and centre (x, y) of each tube; border length of adjacent tubes."""
    count = len(ids)
    sums = np.zeros((count, 6), np.int64)
    sums[:, 0] = areas
    sums[:, 1:4] = np.rint(means * areas[:, None])
    flat = labels.ravel()
    if flow is not None:
        for c in range(2):
            moved = np.bincount(flat, flow[..., c].ravel().astype(np.float64), count)
            sums[:, 4 + c] = np.rint(moved * 16)
    rows, columns = (plane.ravel().astype(np.float64) for plane in np.indices(labels.shape))
    centres = np.stack([np.bincount(flat, plane, count) for plane in (columns, rows)], axis=1)
    centres = np.round(centres / np.maximum(areas, 1)[:, None], 1)
    pairs = np.concatenate([_touching(labels[:, :-1], labels[:, 1:], count), _touching(labels[:-1], labels[1:], count)])
    codes, lengths = np.unique(pairs, return_counts=True)
    touch = {
        f"{ids[c // count]}-{ids[c % count]}": int(n) for c, n in zip(codes.tolist(), lengths.tolist(), strict=True)
    }
    tubes = {str(ids[k]): [sums[k].tolist(), centres[k].tolist()] for k in range(1, count) if areas[k]}
    return {"tubes": tubes, "touch": touch}


def _touching(a: NDArray[np.int32], b: NDArray[np.int32], count: int) -> NDArray[np.int64]:
    differ = a != b
    one, other = a[differ].astype(np.int64), b[differ].astype(np.int64)
    return np.asarray(np.minimum(one, other) * count + np.maximum(one, other), np.int64)


@dataclass(frozen=True)
class Tube:
    """One tube over its lifetime, occlusions included.

    Attributes:
        ids: ids of the segmentation; more than one if the tube was occluded.
        number: from 1, over the whole video, in the order of the first ids.
        first, last: first and last frame with the tube.
        area: px, summed over its frames.
        lab: mean colour, 8-bit Lab; motion: mean, px a frame.
        object: number of its object in its shot: from 1, largest first.
    """

    ids: tuple[int, ...]
    number: int
    first: int
    last: int
    area: int
    lab: tuple[float, float, float]
    motion: tuple[float, float]
    object: int


_Place = tuple[float, float, int]
"""(x, y, area) of a tube in a frame, px."""


@dataclass
class _Stats:
    """Statistics of a tube over several frames; `entry` and `exit` are (x, y, area) in its first and last frame."""

    first: int
    last: int
    sums: NDArray[np.int64]
    entry: _Place
    exit: _Place

    def extend(self, other: _Stats) -> None:
        """Add the statistics of later frames."""
        self.last, self.exit, self.sums = other.last, other.exit, self.sums + other.sums

    def pack(self) -> list[JsonValue]:
        """Row of a task's result: first, last, sums, entry, exit."""
        return [self.first, self.last, self.sums.tolist(), list(self.entry), list(self.exit)]

    @classmethod
    def unpack(cls, row: list[Any]) -> _Stats:
        first, last, sums, (x0, y0, area0), (x1, y1, area1) = row
        return cls(first, last, np.array(sums, np.int64), (x0, y0, area0), (x1, y1, area1))

    @property
    def lab(self) -> NDArray[np.float64]:
        return np.asarray(self.sums[1:4] / max(int(self.sums[0]), 1))

    @property
    def velocity(self) -> NDArray[np.float64]:
        """Displacement of the centre a frame, px; the flow inside plain surfaces would underestimate it."""
        if self.last == self.first:
            return self.motion
        return np.asarray((np.array(self.exit[:2]) - np.array(self.entry[:2])) / (self.last - self.first))

    @property
    def motion(self) -> NDArray[np.float64]:
        return np.asarray(self.sums[4:6] / max(int(self.sums[0]), 1) / 16)


def merge_results(results: Iterable[tuple[int, TaskResult]]) -> TaskResult:
    """Merge the statistics of a run's frames, given as (frame number, result)."""
    tubes: dict[str, _Stats] = {}
    touch: dict[str, int] = defaultdict(int)
    for frame, result in results:
        for tube, (sums, (x, y)) in result["tubes"].items():
            place = (x, y, sums[0])
            now = _Stats(frame, frame, np.array(sums, np.int64), place, place)
            if tube in tubes:
                tubes[tube].extend(now)
            else:
                tubes[tube] = now
        for pair, length in result["touch"].items():
            touch[pair] += length
    return {"tubes": {tube: stats.pack() for tube, stats in tubes.items()}, "touch": dict(touch)}


def tubes_of(results: Iterable[TaskResult], shots: list[tuple[int, int]], side: int, objects: int = 8) -> list[Tube]:
    """All tubes of a video, from the results of its runs (`merge_results`) in order, each with its object.

    Args:
        shots: (first frame, frame after the last) of each shot.
        side: shorter side of the frames, px.
        objects: number of objects that the tubes of a shot are merged to.
    """
    found: dict[int, _Stats] = {}
    touch: dict[tuple[int, int], int] = defaultdict(int)
    for result in sorted(results, key=lambda result: min((row[0] for row in result["tubes"].values()), default=0)):
        for name, row in result["tubes"].items():
            if int(name) in found:
                found[int(name)].extend(_Stats.unpack(row))
            else:
                found[int(name)] = _Stats.unpack(row)
        for pair, length in result["touch"].items():
            one, _, other = pair.partition("-")
            touch[int(one), int(other)] += length
    root = _reattached(found, shots, side)
    return _numbered(found, root, touch, shots, side, objects)


def _reattached(found: Mapping[int, _Stats], shots: list[tuple[int, int]], side: int) -> dict[int, int]:
    """Map each tube id to the first id of the same tube: a tube that appears where an earlier one is expected continues
    it. Each tube is continued at most once, by the most similar one."""
    root = {name: name for name in found}
    pairs = list[tuple[float, int, int]]()
    for start, stop in shots:
        mine = [name for name in sorted(found) if start <= found[name].first < stop]
        large = [name for name in mine if found[name].sums[0] >= LEAST_AREA * side * side * _frames(found[name])]
        pairs += _continuations({name: found[name] for name in large}, side)
    continued, continuing = set[int](), set[int]()
    for _, one, other in sorted(pairs):
        if one not in continued and other not in continuing:
            continued.add(one)
            continuing.add(other)
            root[other] = one
    for name in sorted(root, key=lambda name: found[name].first):
        root[name] = root[root[name]]
    return root


def _frames(stats: _Stats) -> int:
    return stats.last - stats.first + 1


def _continuations(found: Mapping[int, _Stats], side: int) -> Iterator[tuple[float, int, int]]:
    """(dissimilarity, tube, tube that may continue it) of tubes with up to `GAP_FRAMES` - 1 frames between them."""
    names = sorted(found, key=lambda name: found[name].first)
    firsts = [found[name].first for name in names]
    labs = np.array([found[name].lab for name in names]).reshape(-1, 3)
    entries = np.array([found[name].entry[:2] for name in names]).reshape(-1, 2)
    areas = np.array([found[name].sums[0] / _frames(found[name]) for name in names])
    for k, name in enumerate(names):
        before = found[name]
        later = slice(bisect_right(firsts, before.last), bisect_right(firsts, before.last + GAP_FRAMES))
        gaps = np.array(firsts[later]).reshape(-1, 1) - before.last
        apart = entries[later] - (np.array(before.exit[:2]) + before.velocity * gaps)
        distance = np.hypot(apart[:, 0], apart[:, 1]) / side
        colour = np.sqrt(((labs[k] - labs[later]) ** 2).sum(axis=1))
        alike = np.maximum(areas[later], areas[k]) <= GAP_GROWTH * np.minimum(areas[later], areas[k])
        cost = colour / GAP_LAB + distance / GAP_DISTANCE
        for at in np.flatnonzero((distance <= GAP_DISTANCE) & (colour <= GAP_LAB) & alike).tolist():
            yield float(cost[at]), name, names[later.start + at]


def _numbered(
    found: Mapping[int, _Stats], root: Mapping[int, int], touch: Mapping[tuple[int, int], int],
    shots: list[tuple[int, int]], side: int, objects: int,
) -> list[Tube]:  # fmt: skip
    """Tubes with numbers and objects; statistics of continued tubes are summed."""
    ids: dict[int, list[int]] = defaultdict(list)
    for name in sorted(found, key=lambda name: (found[name].first, name)):
        ids[root[name]].append(name)
    sums = {name: np.sum([found[each].sums for each in members], axis=0) for name, members in ids.items()}
    borders: dict[tuple[int, int], int] = defaultdict(int)
    for (one, other), length in touch.items():
        if root[one] != root[other]:
            borders[min(root[one], root[other]), max(root[one], root[other])] += length
    first = {name: found[name].first for name in ids}
    parts = _objects(first, sums, borders, shots, (side, objects))
    out = []
    for number, name in enumerate(sorted(ids), 1):
        whole = _Stats(first[name], found[ids[name][-1]].last, sums[name], found[name].entry, found[name].exit)
        light, a, b = (round(float(value), 2) for value in whole.lab)
        x, y = (round(float(value), 3) for value in whole.motion)
        span = whole.first, whole.last
        out.append(Tube(tuple(ids[name]), number, *span, int(sums[name][0]), (light, a, b), (x, y), parts[name]))
    return out


def _objects(
    first: Mapping[int, int], sums: Mapping[int, NDArray[np.int64]], touch: Mapping[tuple[int, int], int],
    shots: list[tuple[int, int]], size: tuple[int, int],
) -> dict[int, int]:  # fmt: skip
    """Map tubes to objects by agglomerative clustering of adjacent tubes, shot by shot.

    The merge cost is Ward's (area * area / sum * squared difference of colour and motion) over the common border.

    Args:
        first: first frame of each tube; `sums`: its statistics; `touch`: border lengths of adjacent tubes.
        size: (shorter side of the frames in px, number of objects a shot).
    """
    side, objects = size
    scale = MOTION * 360 / side
    out: dict[int, int] = {}
    for start, stop in shots:
        mine = [name for name in sorted(first) if start <= first[name] < stop]
        owner = _merged(mine, sums, touch, scale, objects)
        area: dict[int, int] = defaultdict(int)
        for name, group in owner.items():
            area[group] += int(sums[name][0])
        rank = {group: k for k, group in enumerate(sorted(area, key=lambda group: (-area[group], group)), 1)}
        out |= {name: rank[group] for name, group in owner.items()}
    return out


def _merged(
    mine: list[int], sums: Mapping[int, NDArray[np.int64]], touch: Mapping[tuple[int, int], int], scale: float,
    objects: int,
) -> dict[int, int]:  # fmt: skip
    clusters = _Clusters(mine, sums, touch, scale)
    owner = {name: name for name in mine}
    for _ in range(len(mine) - objects):
        pair = clusters.cheapest_pair()
        if pair is None:
            break
        clusters.merge(*pair)
        owner[mine[pair[1]]] = mine[pair[0]]
    for name in mine:  # ascending, and each cluster is merged into one with a smaller number
        owner[name] = owner[owner[name]]
    return owner


class _Clusters:
    """Clusters of adjacent tubes, numbered by their first tube, and the cheapest merge of each.

    A merge changes the costs of all neighbours of its cluster. Where a cost rises, the cheapest merge of the neighbour
    is found anew only when its former cost, a lower bound, is the least of all.
    """

    def __init__(
        self, mine: list[int], sums: Mapping[int, NDArray[np.int64]], touch: Mapping[tuple[int, int], int], scale: float
    ) -> None:
        table = np.array([sums[name] for name in mine], np.float64).reshape(-1, 6)
        self._area = np.maximum(table[:, 0], 1)
        self._features = np.column_stack([table[:, 1:4], table[:, 4:6] / 16 * scale]) / self._area[:, None]
        at = {name: k for k, name in enumerate(mine)}
        self._near: list[dict[int, int]] = [{} for _ in mine]
        for (one, other), length in touch.items():
            if one in at and other in at:
                self._near[at[one]][at[other]] = self._near[at[other]][at[one]] = length
        self._least = np.full(len(mine), np.inf)
        self._partner = np.full(len(mine), -1)
        self._stale = np.zeros(len(mine), np.bool_)
        for k in range(len(mine)):
            self._find(k)

    def cheapest_pair(self) -> tuple[int, int] | None:
        """The pair of the cheapest merge, of equal ones the first; None if no clusters are adjacent."""
        while True:
            least = self._least.min(initial=np.inf)
            if least == np.inf:
                return None
            found = np.flatnonzero(self._least == least)
            stale = found[self._stale[found]]
            if not len(stale):
                pairs = ((k, int(self._partner[k])) for k in found.tolist())
                return min((min(pair), max(pair)) for pair in pairs)
            for k in stale.tolist():
                self._find(k)

    def merge(self, a: int, b: int) -> None:
        """Merge the cluster `b` into `a`."""
        area, near = self._area, self._near
        total = area[a] + area[b]
        self._features[a] = (self._features[a] * area[a] + self._features[b] * area[b]) / total
        area[a] = total
        self._least[b] = np.inf
        for other, length in near[b].items():
            del near[other][b]
            if other != a:
                near[a][other] = near[other][a] = near[a].get(other, 0) + length
        near[b] = {}
        self._find(a)
        others, costs = self._costs(a)
        cheaper = (costs < self._least[others]) | ((costs == self._least[others]) & (a < self._partner[others]))
        dearer = np.isin(self._partner[others], (a, b)) & (costs > self._least[others])
        renamed = (self._partner[others] == b) & (costs == self._least[others])
        self._stale[others[dearer]] = True
        now = others[cheaper | renamed]
        self._least[now], self._partner[now], self._stale[now] = costs[cheaper | renamed], a, False

    def _costs(self, k: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """The neighbours of a cluster, and the costs of merging it with each."""
        others = np.fromiter(self._near[k], np.int64, len(self._near[k]))
        lengths = np.fromiter(self._near[k].values(), np.float64, len(self._near[k]))
        apart = ((self._features[k] - self._features[others]) ** 2).sum(axis=1)
        weight = self._area[k] * self._area[others] / (self._area[k] + self._area[others])
        return others, weight * (apart + 4) / lengths

    def _find(self, k: int) -> None:
        """Find the cheapest merge of a cluster; of equal ones, with the smallest number."""
        others, costs = self._costs(k)
        self._stale[k] = False
        self._least[k] = costs.min(initial=np.inf)
        self._partner[k] = others[costs == self._least[k]].min(initial=len(self._least)) if len(others) else -1
