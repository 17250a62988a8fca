"""Synthesis on a device: launches of `patchmatch.cl` and `fields.cl`, nothing more. The specification: `reference`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.compute import Device, DeviceArray, Launch
from pipeline.synthesis.goal import SCALE_SHIFT, STEP_SCALE, Goal, cosines, steps_table, tables, taps
from pipeline.synthesis.images import TAIL, Bytes, Style, Target, padded
from pipeline.synthesis.images import packed as pack
from pipeline.synthesis.operations import Key, Loaded, Search, Sitting

_HERE = Path(__file__)
_COMMON, _FIELDS, _PATCHES = (_HERE.with_name(f"{name}.cl") for name in ("common", "fields", "patchmatch"))
Size = tuple[int, int]


class Kernels:
    """The operations of `operations.Operations` on a device; what they make stays there."""

    def __init__(self, device: Device) -> None:
        self.device = device
        self._nothing = device.zeros((16,), np.int32)
        self.costs: DeviceArray | None = None
        """What the goal function came to at each pixel in the latest iteration, float32 (h, w)."""
        self._constants: dict[Goal, tuple[DeviceArray, ...]] = {}
        self._cosines = device.upload(cosines())

    def upload(self, array: NDArray[Any]) -> DeviceArray:
        return self.device.upload(array)

    def fetch(self, array: DeviceArray) -> NDArray[Any]:
        return self.device.download(array)

    def finish(self) -> None:
        """Wait for what has been handed over."""
        self.device.finish()

    def _tables(self, goal: Goal) -> tuple[DeviceArray, ...]:
        if goal not in self._constants:
            made = tables(goal)
            arrays = (made.weights, made.keyed, made.step_weights)
            self._constants[goal] = tuple(self.upload(a) for a in arrays)
        return self._constants[goal]

    def load(self, style: Style, goal: Goal) -> Loaded[DeviceArray]:
        """A style, ready for patches: padded features, taps as pixels of that image."""
        width = style.size[0] + 2 * goal.pad
        found = taps(goal.radius)
        turns = np.ascontiguousarray(found[..., 1] * width + found[..., 0], np.int32)
        return Loaded(
            style, goal,
            self.upload(padded(style.features, goal.pad)),
            self._or_nothing(style.bins), self._or_nothing(style.usable), self._or_nothing(style.distance),
            self.upload(turns), self.upload(steps_table(goal.radius, style.bins is not None)),
        )  # fmt: skip

    def _or_nothing(self, array: NDArray[Any] | None) -> DeviceArray:
        return self._nothing if array is None else self.upload(array)

    def margined(self, plane: Bytes, margin_px: int) -> DeviceArray:
        """A plane with its border repeated around it."""
        return self.upload(padded(plane, margin_px))

    def seat(self, style: Loaded[DeviceArray], target: Target) -> Sitting[DeviceArray]:
        """A frame, its colours not yet rendered."""
        goal, (width, height) = style.goal, target.size
        blank = pack(goal, np.zeros((height, width, goal.colours), np.uint8), target.guides)
        stride, rows = width + 2 * goal.radius, height + 2 * goal.radius
        field = self.device.empty((rows * stride * 2 + TAIL,), np.int16)
        bins = None if target.bins is None else self.upload(target.bins)
        distance = None if target.distance is None else self.upload(target.distance)
        return Sitting(target.size, self.upload(padded(blank, goal.radius)), field, bins, distance)

    def _defines(self, style: Loaded[DeviceArray]) -> dict[str, int]:
        return {
            "RADIUS": style.goal.radius,
            "CHANNELS": style.goal.channels,
            "COLOURS": style.goal.colours,
            "PAD": style.goal.pad,
            "ROTATE": int(style.style.bins is not None),
            "HOLES": int(style.style.usable is not None),
        }

    def _at(self, style: Loaded[DeviceArray], name: str, size: Size, *args: Any, over: Size | None = None) -> Launch:
        """Over every pixel; the frame's width and height are the last two arguments."""
        kernel = self.device.kernel(_FIELDS, name, self._defines(style), _COMMON)
        return kernel.at(over or size, *args, *size)

    def scatter(self, style: Loaded[DeviceArray], size: Size, key: Key) -> DeviceArray:
        """Random offsets."""
        out = self.device.empty((size[1], size[0], 2))
        args = (out, style.usable, *_words(key), *style.style.first, *style.size)
        self.device.run(self._at(style, "scatter", size, *args))
        return out

    def render(self, style: Loaded[DeviceArray], sitting: Sitting[DeviceArray], offsets: DeviceArray) -> None:
        """Show the offsets' colours in the frame, with a margin in which each border pixel's texture goes on."""
        margin = 2 * style.goal.radius
        over = (sitting.size[0] + margin, sitting.size[1] + margin)
        args = (
            offsets, sitting.bins or self._nothing, style.features, style.bins, self._cosines, sitting.packed,
            sitting.field, *style.size,
        )  # fmt: skip
        self.device.run(self._at(style, "render", sitting.size, *args, over=over))

    def penalty(self, style: Loaded[DeviceArray], size: Size, offsets: DeviceArray) -> DeviceArray:
        """Eq. 8 for each pixel of the style: how often it is used, blurred, beyond the limit."""
        goal, (width, height) = style.goal, style.size
        counts = self.device.zeros((height, width), np.int32)
        rows, out = self.device.empty((height, width)), self.device.empty((height, width))
        alike = max(1.0, size[0] * size[1] / _usable_area(style.style))
        threshold = np.float32(goal.h_limit * alike)
        slope = np.float32(goal.w_h / alike * tables(goal).centre)
        self.device.run(self._at(style, "count", size, offsets, counts, width, height))
        self.device.run(self._at(style, "blur_counts", style.size, counts, rows))
        self.device.run(self._at(style, "crowding", style.size, rows, out, threshold, slope))
        return out

    def improve(
        self, style: Loaded[DeviceArray], sitting: Sitting[DeviceArray], offsets: DeviceArray,
        penalty: DeviceArray | None, key: Key, round_: int, search: Search, top: int = 0,
    ) -> DeviceArray:  # fmt: skip
        """One iteration: every pixel's offset, or a better one from its neighbours, the ribbons or chance.

        Args:
            top: row of the frame that is the first one here; chance is keyed by the frame's rows.
        """
        goal, made, none = style.goal, tables(style.goal), self._nothing
        out = self.device.empty((sitting.size[1], sitting.size[0], 2))
        self.costs = self.device.empty((sitting.size[1], sitting.size[0]))
        weights, keyed, step_weights = self._tables(goal)
        past = sitting.past
        args = (
            offsets, out, self.costs, sitting.packed, sitting.field,
            sitting.bins or none, style.features, style.bins, style.usable, style.distance, weights, style.turns,
            self._cosines, style.steps, step_weights, sitting.before or none, penalty or none,
            sitting.distance or none, sitting.was or none, past.packed if past else none,
            past.visible if past else none, keyed, sitting.ribbons or none, sitting.given or none,
            round(goal.r_max_px2),
            np.float32(goal.w_sc * made.unit / STEP_SCALE), np.float32(goal.w_tc / goal.colours * made.centre),
            np.float32(goal.d_max_px), np.float32(goal.w_dt * made.centre), search.jump, np.float32(search.search_px),
            np.float32(search.ribbon_px), *_words(key), np.uint32(round_), top, *style.size,
        )  # fmt: skip
        kernel = self.device.kernel(_PATCHES, "improve", self._terms(style, sitting, penalty), _COMMON)
        self.device.run(kernel.at(sitting.size, *args, *sitting.size))
        return out

    def _terms(
        self, style: Loaded[DeviceArray], sitting: Sitting[DeviceArray], penalty: DeviceArray | None
    ) -> dict[str, int]:
        """Which terms the kernel is compiled with: what is not there costs nothing."""
        present = {
            "COHERENT": style.goal.w_sc > 0,
            "TEMPORAL": sitting.before is not None,
            "HISTOGRAM": penalty is not None,
            "LINES": sitting.distance is not None,
            "KEYED": sitting.past is not None,
            "RIBBONS": sitting.ribbons is not None,
            "FROZEN": sitting.given is not None,
        }
        shape = {"VECTORS": style.goal.vectors, "SCALE_SHIFT": SCALE_SHIFT}
        return self._defines(style) | shape | {name: int(there) for name, there in present.items()}

    def advect(
        self, style: Loaded[DeviceArray], sitting: Sitting[DeviceArray], offsets: DeviceArray,
        bins: DeviceArray | None, way: DeviceArray, visible: DeviceArray,
    ) -> DeviceArray:  # fmt: skip
        """Another frame's offsets, carried to this one: nearest sample, extrapolated through both directions.

        Args:
            offsets, bins: the other frame's.
            way: float32 (h, w, 2): from each pixel of this frame to where it is in the other, px.
            visible: uint8 (h, w): 0 = not seen there.
        """
        out = self.device.empty((sitting.size[1], sitting.size[0], 2))
        args = (
            offsets, bins or self._nothing, way, visible, style.bins, self._cosines, style.usable, out, *style.size,
        )  # fmt: skip
        self.device.run(self._at(style, "advect", sitting.size, *args))
        return out

    def upsample(
        self, coarse: Loaded[DeviceArray], sitting: Sitting[DeviceArray], offsets: DeviceArray,
        style: Loaded[DeviceArray], to: Sitting[DeviceArray],
    ) -> DeviceArray:  # fmt: skip
        """A coarser level's offsets at twice the size, extrapolated as `advect` does."""
        out = self.device.empty((to.size[1], to.size[0], 2))
        args = (
            offsets, sitting.bins or self._nothing, coarse.bins, self._cosines, style.usable, out, *coarse.size,
            *sitting.size, *style.size,
        )  # fmt: skip
        self.device.run(self._at(style, "upsample", to.size, *args))
        return out

    def merge(
        self, style: Loaded[DeviceArray], size: Size, first: DeviceArray, second: DeviceArray, share: float, key: Key
    ) -> DeviceArray:
        """Each pixel's offset from `first` with probability `share`, else from `second`; what is there wins."""
        out = self.device.empty((size[1], size[0], 2))
        args = (first, second, style.usable, out, np.float32(share), *_words(key), *style.style.first, *style.size)
        self.device.run(self._at(style, "merge", size, *args))
        return out

    def recall(self, style: Loaded[DeviceArray], size: Size, offsets: DeviceArray) -> DeviceArray:
        """Colours of offsets, uint8 (h, w, 4), the fourth 0 where there are none."""
        out = self.device.empty((size[1], size[0], 4), np.uint8)
        self.device.run(self._at(style, "recall", size, offsets, style.features, out, *style.size))
        return out

    def impose(self, style: Loaded[DeviceArray], size: Size, given: DeviceArray, offsets: DeviceArray) -> DeviceArray:
        """The given offsets where there are any. In place."""
        self.device.run(self._at(style, "impose", size, given, offsets))
        return offsets


def _words(key: Key) -> tuple[np.uint32, np.uint32]:
    return np.uint32(key[0] & 0xFFFFFFFF), np.uint32(key[1] & 0xFFFFFFFF)


def _usable_area(style: Style) -> int:
    return style.size[0] * style.size[1] if style.usable is None else max(1, int(np.count_nonzero(style.usable)))
