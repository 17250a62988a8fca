"""Renderer of cut-outs: anti-aliased colours and exact passes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pipeline.frames import Flow, Frame, Mask
from pipeline.scenes.base import CutOut, SceneFrame, Spot
from pipeline.scenes.pose import Array, Pose


@dataclass(frozen=True)
class _Patch:
    """A cut-out in one frame, within its bounding rectangle of pixels."""

    number: int
    """Index of the cut-out in the stage."""
    cutout: CutOut
    rows: slice
    columns: slice
    spot: Spot
    slope: tuple[Array, Array]
    """Gradient of the outline function along x and y, per px."""

    @cached_property
    def distance_px(self) -> Array:
        """Signed distance to the outline, px; negative inside."""
        steep: Array = np.maximum(np.hypot(*self.slope), 1e-12)
        return -self.spot.depth / steep

    @cached_property
    def coverage(self) -> Array:
        """Covered fraction of each pixel, 0..1. One sample per pixel suffices for nearly straight outlines."""
        return np.clip(0.5 - self.distance_px, 0.0, 1.0)

    @property
    def window(self) -> tuple[slice, slice]:
        return self.rows, self.columns


class Stage:
    """A `Scene` of cut-outs, ordered from back to front."""

    def __init__(self, name: str, cutouts: Sequence[CutOut], size: tuple[int, int], frames: int, fps: float) -> None:
        self.name, self.size, self.frames, self.fps = name, size, frames, fps
        self._cutouts = tuple(cutouts)
        names = list(dict.fromkeys(c.thing for c in cutouts))
        self.things: Mapping[int, str] = dict(enumerate(names, start=1))
        self._ids = np.array([names.index(c.thing) + 1 for c in cutouts], dtype=np.int32)
        width, height = size
        self._to_px = Pose(height, 0, 0, height, (width - 1) / 2, -0.5)

    def __iter__(self) -> Iterator[SceneFrame]:
        return map(self.frame, range(self.frames))

    def image(self, index: int) -> Frame:
        """Frame `index` alone."""
        return self._paint(self._patches(index))

    def frame(self, index: int) -> SceneFrame:
        """Frame `index` with every pass."""
        patches = self._patches(index)
        top = self._top(patches)
        after, hidden_after = self._follow(top, index, +1)
        before, hidden_before = self._follow(top, index, -1)
        normals, orientation = _surface(patches, top)
        return SceneFrame(
            image=self._paint(patches),
            ids=self._ids[top],
            velocity_next=after,
            velocity_previous=-before,
            normals=normals,
            orientation=orientation,
            lines=self._lines(patches),
            occluded_next=hidden_after,
            occluded_previous=hidden_before,
        )

    def _pose(self, cutout: CutOut, index: int) -> Pose:
        return self._to_px @ cutout.motion(index / self.fps)

    def _patches(self, index: int) -> list[_Patch]:
        made = (self._patch(number, self._pose(self._cutouts[number], index)) for number in range(len(self._cutouts)))
        return [patch for patch in made if patch is not None]

    def _patch(self, number: int, pose: Pose) -> _Patch | None:
        cutout = self._cutouts[number]
        window = self._window(cutout, pose)
        if window is None or pose.area < 1e-6:
            return None
        rows, columns = window
        y = np.arange(rows.start, rows.stop, dtype=np.float64)[:, None]
        x = np.arange(columns.start, columns.stop, dtype=np.float64)
        u, v = pose.inverse().apply(x, y)
        value = cutout.outline(u, v)
        slope = (_slope(value), _slope(value.T).T)
        return _Patch(number, cutout, rows, columns, Spot(u, v, -value, pose.area**-0.5), slope)

    def _window(self, cutout: CutOut, pose: Pose) -> tuple[slice, slice] | None:
        """Rows and columns of the cut-out's bounding rectangle, at least two each; None if outside the picture."""
        width, height = self.size
        if cutout.box is None:
            return slice(0, height), slice(0, width)
        left, top, right, bottom = cutout.box
        x, y = pose.apply(np.array([left, right, left, right]), np.array([top, top, bottom, bottom]))
        columns, rows = _span(x, width), _span(y, height)
        return None if columns is None or rows is None else (rows, columns)

    def _paint(self, patches: list[_Patch]) -> Frame:
        """Composite the cut-outs front to back, so that hidden pixels are not painted: uint8 (h, w, 3)."""
        width, height = self.size
        canvas, clear = np.zeros((height, width, 3)), np.ones((height, width))
        for patch in reversed(patches):
            share = patch.coverage * clear[patch.window]
            visible = share > 1e-4
            if visible.any():
                colour = np.clip(patch.cutout.paint(patch.spot.at(visible)), 0, 1)
                canvas[patch.window][visible] += share[visible][:, None] * colour
                clear[patch.window] -= share
        return np.asarray(np.rint(canvas.clip(0, 1) * 255), dtype=np.uint8)

    def _top(self, patches: list[_Patch]) -> np.ndarray[tuple[int, ...], np.dtype[np.intp]]:
        """Index of the topmost cut-out at each pixel's centre: (h, w)."""
        width, height = self.size
        top = np.zeros((height, width), dtype=np.intp)
        for patch in patches:
            top[patch.window][patch.spot.depth > 0] = patch.number
        return top

    def _lines(self, patches: list[_Patch]) -> np.ndarray[tuple[int, ...], np.dtype[np.float32]]:
        width, height = self.size
        lines = np.zeros((height, width))
        for patch in patches:
            half = patch.cutout.line_px / 2
            ink = np.clip(half + 0.5 - np.abs(patch.distance_px), 0, 1) * (half > 0)
            lines[patch.window] = np.maximum(lines[patch.window] * (1 - patch.coverage), ink)
        return lines.astype(np.float32)

    def _follow(self, top: np.ndarray[tuple[int, ...], np.dtype[np.intp]], index: int, step: int) -> tuple[Flow, Mask]:
        """Flow to the next frame (`step` 1) or the previous one (-1), px, and the mask of points hidden there."""
        flow = np.zeros((*top.shape, 2), dtype=np.float32)
        hidden = np.ones(top.shape, dtype=np.bool_)
        for number in np.unique(top):
            rows, columns = np.nonzero(top == number)
            x, y = columns.astype(np.float64), rows.astype(np.float64)
            then = self._pose(self._cutouts[number], index + step) @ self._pose(self._cutouts[number], index).inverse()
            to_x, to_y = then.apply(x, y)
            flow[rows, columns] = np.stack([to_x - x, to_y - y], axis=-1)
            hidden[rows, columns] = self._covered(number, to_x, to_y, index + step)
        return flow, hidden

    def _covered(self, number: int, x: Array, y: Array, index: int) -> Mask:
        """Flags of points (x, y) of cut-out `number` that are hidden or outside the picture in frame `index`."""
        width, height = self.size
        covered: Mask = (x < 0) | (x > width - 1) | (y < 0) | (y > height - 1)
        if not 0 <= index < self.frames:
            return np.ones_like(covered)
        for above in self._cutouts[number + 1 :]:
            pose = self._pose(above, index)
            near = np.flatnonzero(~covered & self._within(above, pose, x, y))
            if near.size and pose.area >= 1e-6:
                covered[near] = above.outline(*pose.inverse().apply(x[near], y[near])) < 0
        return covered

    def _within(self, cutout: CutOut, pose: Pose, x: Array, y: Array) -> Mask:
        window = self._window(cutout, pose)
        if window is None:
            return np.zeros(x.shape, dtype=np.bool_)
        rows, columns = window
        inside: Mask = (x >= columns.start - 1) & (x <= columns.stop) & (y >= rows.start - 1) & (y <= rows.stop)
        return inside


def _slope(values: Array) -> Array:
    """Central differences along x, one-sided at both ends: `np.gradient(values, axis=1)`, in a third of its time."""
    slope = np.empty_like(values)
    slope[:, 0], slope[:, -1] = values[:, 1] - values[:, 0], values[:, -1] - values[:, -2]
    slope[:, 1:-1] = (values[:, 2:] - values[:, :-2]) / 2
    return slope


def _span(values: Array, count: int) -> slice | None:
    start, stop = int(np.floor(values.min())) - 2, int(np.ceil(values.max())) + 3
    if stop <= 0 or start >= count:
        return None
    start = min(max(start, 0), count - 2)
    return slice(start, max(min(stop, count), start + 2))


def _surface(
    patches: list[_Patch], top: np.ndarray[tuple[int, ...], np.dtype[np.intp]]
) -> tuple[np.ndarray[tuple[int, ...], np.dtype[np.float32]], np.ndarray[tuple[int, ...], np.dtype[np.float32]]]:
    """Normals of the bulging cut-outs, float32 (h, w, 3), and directions along their outlines, float32 (h, w), rad."""
    normals = np.zeros((*top.shape, 3), dtype=np.float32)
    orientation = np.zeros(top.shape, dtype=np.float32)
    for patch in patches:
        visible = top[patch.window] == patch.number
        right, down = (s[visible] for s in patch.slope)
        steep = np.maximum(np.hypot(right, down), 1e-12)
        lean = np.clip(1 - patch.spot.depth[visible] / patch.cutout.bulge, 0, 1) if patch.cutout.bulge else 0 * steep
        normal = np.stack([lean * right / steep, lean * down / steep, np.sqrt(1 - lean**2)], axis=-1)
        normals[patch.window][visible] = normal / np.linalg.norm(normal, axis=-1, keepdims=True)
        orientation[patch.window][visible] = np.mod(np.arctan2(right, -down), np.pi)
    return normals, np.where(orientation >= np.float32(np.pi), np.float32(0), orientation)
