"""Faces found now and then (viola2001rapid) and followed in between, as soft bumps over whole heads.

A detector that runs on every frame costs more than all the rest of a method, and its boxes tremble and drop out. So it
searches the whole frame now and then, spread over the next few frames, and in between the surroundings of the faces it
knows. Between, a face
moves with the median flow inside it, its box eases towards the latest detection, and its strength rises and falls
slowly. The more often a face has been met, the longer it is kept without being met again.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Arrays, State
from pipeline.frames import Flow, Plane
from pipeline.segmentation.face_detector import SLICES, Boxes, FaceDetector, join, slices
from pipeline.segmentation.motion import median_motion

Tracks = NDArray[np.float64]
"""One face a row: eased box (cx, cy, width, height), latest box, strength 0..1, frames unseen, detections. Px of the
frame."""

_BOX, _GOAL, _STRENGTH, _UNSEEN, _HITS = slice(0, 4), slice(4, 8), 8, 9, 10
_COLUMNS = 11
_NEARBY_SEARCHES = 2
"""Searches around known faces for each search of the whole frame."""
_MIN_PATIENCE, _MAX_PATIENCE = 1.0, 2.0
"""How long a face is kept after its first and after many detections, in parts of `keep_frames`."""
_SCALE_FACTOR = 1.2
_FINE_SCALE_FACTOR = 1.08
_HALF_WIDTH, _HALF_HEIGHT, _RAISE = 0.55, 0.75, 0.1
"""The head around a detected face, in sides of its box, which ends at brows and chin."""
_FADE = 1.5
"""The bump is 1 in the head's ellipse and 0 outside the ellipse this many times larger."""


@dataclass
class _Search:
    """A search of the whole picture under way."""

    gray: NDArray[np.uint8]
    hits: NDArray[np.int32] = field(default_factory=lambda: np.empty((0, 4), np.int32))
    done: int = 0
    """Slices."""
    flows: list[Flow] = field(default_factory=list)
    """What has moved since, frame by frame."""


class FaceTracker:
    """Follows the faces of one shot. Not thread-safe; the cascade is its own and is read on the first detection.

    Args:
        size: (width, height) of the frames, px.
        every_frames: frames between searches of the whole frame, counted from the shot's first.
        half_life_frames: of easing boxes and strengths.
        smallest: smallest face, as a fraction of the frame's shorter side.
        keep_frames: how long a face is kept without being met again, at first; None = `every_frames`.
    """

    def __init__(
        self, size: tuple[int, int], every_frames: int, half_life_frames: float, smallest: float,
        keep_frames: int | None = None,
    ) -> None:  # fmt: skip
        self._size = size
        self._keep = every_frames if keep_frames is None else keep_frames
        self._every = every_frames
        self._gain = 1.0 - 0.5 ** (1.0 / half_life_frames) if half_life_frames > 0 else 1.0
        self._smallest = smallest
        self._finder = FaceDetector()
        self._search: _Search | None = None
        self.tracks: Tracks = np.empty((0, _COLUMNS))

    def looks(self, age: int) -> bool:
        """Whether `step` needs the picture of frame number `age`."""
        return age % max(1, self._every // _NEARBY_SEARCHES) == 0 or age % self._every == 0

    def step(self, gray: NDArray[np.uint8] | None, flow: Flow | None, age: int) -> None:
        """Take in frame number `age` of the shot.

        Args:
            gray: the frame, scaled down; None where `looks` says no.
            flow: from the previous frame, px of the frame, sampled on a grid of any size over it.
            age: 0 forgets every face.
        """
        if age == 0:
            self.tracks, self._search = np.empty((0, _COLUMNS)), None
        elif flow is not None:
            self._move(self.tracks, flow)
            if self._search:
                self._search.flows.append(flow)
        self.tracks[:, _UNSEEN] += 1
        if self._search and self._search.done == SLICES:
            self._meet_found(self._search)
        if gray is not None and age % self._every == 0:
            self._begin(gray, at_once=age == 0 or self._every <= SLICES, fresh=age == 0)
        elif gray is not None and not self._search and age % max(1, self._every // _NEARBY_SEARCHES) == 0:
            self._meet(self._search_nearby(gray), newcomers=False)
        self._ease()

    def _begin(self, gray: NDArray[np.uint8], at_once: bool, fresh: bool) -> None:
        self._search = _Search(gray)
        while at_once and self._search.done < SLICES:
            self.continue_search()
        if at_once:
            self._meet_found(self._search, fresh)

    def continue_search(self) -> None:
        """The next slice of the search under way, if there is one. Call it once after every `step`, or not at all."""
        search = self._search
        if search is None or search.done == SLICES:
            return
        least = max(20, round(self._smallest * min(search.gray.shape)))
        sizes = slices(_SCALE_FACTOR, least, min(search.gray.shape))[search.done]
        search.hits = np.vstack([search.hits, self._finder.hits(search.gray, _SCALE_FACTOR, *sizes)])
        search.done += 1

    def _meet_found(self, search: _Search, fresh: bool = False) -> None:
        """Who was found is met where they have moved since."""
        boxes = join(search.hits) / self._scale(search.gray)
        for flow in search.flows:
            self._move(boxes, flow)
        self._meet(boxes, newcomers=True, fresh=fresh)
        self._search = None

    def state(self) -> State:
        """All that the next step depends on."""
        state: State = {"faces": self.tracks.copy()}
        if self._search:
            search = self._search
            state |= {"search.gray": search.gray, "search.hits": search.hits, "search.done": np.array(search.done)}
            if search.flows:
                state["search.flows"] = np.stack(search.flows)
        return state

    def restore(self, state: Arrays) -> None:
        """Go on, to the bit, from where `state` was taken."""
        self.tracks = np.array(state["faces"], np.float64)
        self._search = None
        if "search.gray" in state:
            gray, hits = np.asarray(state["search.gray"], np.uint8), np.asarray(state["search.hits"], np.int32)
            self._search = _Search(gray, hits, int(state["search.done"]), list(state.get("search.flows", ())))

    def bump(self, shape: tuple[int, int]) -> Plane:
        """Strength of the nearest head, float32 `shape` over the frame, in [0, 1]."""
        height, width = shape
        xs = (np.arange(width, dtype=np.float32) + 0.5) * np.float32(self._size[0] / width)
        ys = (np.arange(height, dtype=np.float32) + 0.5) * np.float32(self._size[1] / height)
        plane = np.zeros(shape, np.float32)
        for cx, cy, w, h, strength in self.tracks[:, [0, 1, 2, 3, _STRENGTH]].astype(np.float32):
            across = ((xs - cx) / (w * np.float32(_HALF_WIDTH))) ** 2
            down = ((ys - cy + h * np.float32(_RAISE)) / (h * np.float32(_HALF_HEIGHT))) ** 2
            distance = np.sqrt(across[None, :] + down[:, None])
            ramp = np.clip((np.float32(_FADE) - distance) / np.float32(_FADE - 1), 0, 1)
            np.maximum(plane, strength * ramp * ramp * (3 - 2 * ramp), out=plane)
        return plane

    def _move(self, rows: NDArray[np.float64], flow: Flow) -> None:
        """Move boxes, or whole tracks, by the median flow of their middle half; in place."""
        scale = np.array([flow.shape[1] / self._size[0], flow.shape[0] / self._size[1]])
        for row in rows:
            centre, quarter = row[0:2] * scale, row[2:4] * scale / 4
            (x0, y0), (x1, y1) = np.maximum(centre - quarter, 0).astype(int), np.ceil(centre + quarter).astype(int)
            inside = flow[y0 : y1 + 1, x0 : x1 + 1]
            if inside.size:
                shift = median_motion(inside)
                row[0:2] += shift
                if len(row) == _COLUMNS:
                    row[4:6] += shift

    def _search_nearby(self, gray: NDArray[np.uint8]) -> Boxes:
        """Boxes, px of the frame, around every known face: in twice its size, of about its size, in finer steps."""
        found = [np.empty((0, 4))]
        for cx, cy, width, height in self.tracks[:, _GOAL] * self._scale(gray):
            x, y = max(0, int(cx - width)), max(0, int(cy - height))
            window = gray[y : int(cy + height) + 1, x : int(cx + width) + 1]
            if min(window.shape) > 20:
                boxes = self._finder.find(window, _FINE_SCALE_FACTOR, max(20, int(width * 0.75)), int(width * 1.35))
                boxes[:, :2] += x, y
                found.append(boxes / self._scale(gray))
        return np.vstack(found)

    def _scale(self, gray: NDArray[np.uint8]) -> NDArray[np.float64]:
        return np.tile([gray.shape[1] / self._size[0], gray.shape[0] / self._size[1]], 2)

    def _meet(self, boxes: Boxes, newcomers: bool, fresh: bool = False) -> None:
        """Give every detection to the nearest face that no other has taken, else to a new one if those may come."""
        free = np.ones(len(self.tracks), bool)
        new = []
        for box in boxes:
            apart = np.linalg.norm(self.tracks[:, 4:6] - box[:2], axis=1) / np.maximum(self.tracks[:, 6], box[2])
            near = np.flatnonzero(free & (apart < 0.5))
            if near.size:
                nearest = int(near[apart[near].argmin()])
                free[nearest] = False
                self._renew(nearest, box)
            elif newcomers:
                new.append([*box, *box, float(fresh), 0.0, 1.0])
        self.tracks = np.vstack([self.tracks, np.array(new, np.float64).reshape(-1, _COLUMNS)])

    def _renew(self, index: int, box: NDArray[np.float64]) -> None:
        self.tracks[index, _GOAL] = box
        self.tracks[index, _UNSEEN] = 0
        self.tracks[index, _HITS] += 1

    def _ease(self) -> None:
        tracks = self.tracks
        patience = self._keep * np.clip(tracks[:, _HITS] / 4, _MIN_PATIENCE, _MAX_PATIENCE)
        held = tracks[:, _UNSEEN] <= patience
        tracks[:, _BOX] += self._gain * (tracks[:, _GOAL] - tracks[:, _BOX])
        tracks[:, _STRENGTH] += self._gain * (held - tracks[:, _STRENGTH])
        inside = ((tracks[:, 4:6] >= 0) & (tracks[:, 4:6] < self._size)).all(axis=1)
        self.tracks = tracks[(held | (tracks[:, _STRENGTH] > 0.02)) & inside]
