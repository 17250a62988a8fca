"""Synthesis operations on an OpenCL device: launches the kernels of `patchmatch.cl` and `fields.cl`.

`reference` is their specification and gives the same bytes.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from pipeline.arrays import AnyArray
from pipeline.compute import Device, DeviceArray, Launch
from pipeline.frames import Plane
from pipeline.synthesis.antialias import STEP_BITS, cubic_taps
from pipeline.synthesis.energy import SCALE_SHIFT, Energy, cosines, tables, tap_table, taps
from pipeline.synthesis.images import TAIL, Bytes, StyleImage, Target, padded
from pipeline.synthesis.images import packed as pack
from pipeline.synthesis.operations import FrameState, LoadedStyle, RandomKey, Search, iteration, key_words

_HERE = Path(__file__)
_COMMON, _FIELDS, _PATCHES, _ANTIALIAS = (
    _HERE.with_name(f"{name}.cl") for name in ("common", "fields", "patchmatch", "antialias")
)
_OFF: Mapping[str, int] = {"VOTES": 0, "BIASED": 0}
"""Macros of `fields.cl` that single kernels set."""
Size = tuple[int, int]


class OpenCLOperations:
    """Implementation of `operations.Operations` on a device. Results stay in device memory."""

    def __init__(self, device: Device) -> None:
        self.device = device
        self._placeholder = device.zeros((16,), np.int32)
        self.costs: DeviceArray | None = None
        """Cost of each pixel after the latest iteration, float32 (h, w); 0 at pixels that were not improved."""
        self._constants: dict[Energy, tuple[DeviceArray, ...]] = {}
        self._cosines, self._cubic_taps = device.upload(cosines()), device.upload(cubic_taps())

    def upload(self, array: AnyArray) -> DeviceArray:
        """Copy an array to device memory."""
        return self.device.upload(array)

    def fetch(self, array: DeviceArray) -> AnyArray:
        """Copy an array from device memory."""
        return self.device.download(array)

    def finish(self) -> None:
        """Wait until all submitted work is done."""
        self.device.finish()

    def _tables(self, energy: Energy) -> tuple[DeviceArray, ...]:
        if energy not in self._constants:
            made = tables(energy)
            arrays = (made.weights, made.tap_weights, made.change_fraction)
            self._constants[energy] = tuple(self.upload(a) for a in arrays)
        return self._constants[energy]

    def load(self, style: StyleImage, energy: Energy) -> LoadedStyle[DeviceArray]:
        """Upload a style: features padded for patches, and patch taps as pixel indices of the padded image."""
        width = style.size[0] + 2 * energy.pad
        found = taps(energy.radius)
        tap_indices = np.ascontiguousarray(found[..., 1] * width + found[..., 0], np.int32)
        return LoadedStyle(
            style, energy,
            self.upload(padded(style.features, energy.pad)),
            self._or_placeholder(style.bins), self._or_placeholder(style.usable), self._or_placeholder(style.distance),
            self.upload(tap_indices), self.upload(tap_table(energy.radius, style.bins is not None)),
        )  # fmt: skip

    def _or_placeholder(self, array: AnyArray | None) -> DeviceArray:
        return self._placeholder if array is None else self.upload(array)

    def prepare(self, style: LoadedStyle[DeviceArray], target: Target) -> FrameState[DeviceArray]:
        """Upload a frame; its colours are not rendered yet."""
        energy, (width, height) = style.energy, target.size
        blank = pack(energy, np.zeros((height, width, energy.colours), np.uint8), target.guides)
        stride, rows = width + 2 * energy.radius, height + 2 * energy.radius
        field = self.device.empty((rows * stride * 2 + TAIL,), np.int16)
        bins = None if target.bins is None else self.upload(target.bins)
        distance = None if target.distance is None else self.upload(target.distance)
        return FrameState(target.size, self.upload(padded(blank, energy.radius)), field, bins, distance)

    def _defines(self, style: LoadedStyle[DeviceArray]) -> dict[str, int]:
        return {
            "RADIUS": style.energy.radius,
            "CHANNELS": style.energy.channels,
            "COLOURS": style.energy.colours,
            "GUIDES": len(style.energy.guides),
            "PAD": style.energy.pad,
            "ROTATE": int(style.style.bins is not None),
            "MASKED": int(style.style.usable is not None),
        }

    def _at(
        self, style: LoadedStyle[DeviceArray], name: str, size: Size, *args: Any, over: Size | None = None,
        macros: Mapping[str, int] = MappingProxyType({}),
    ) -> Launch:  # fmt: skip
        """A launch with one work item per pixel; appends the frame's width and height to the arguments."""
        kernel = self.device.kernel(_FIELDS, name, {**_OFF, **self._defines(style), **macros}, _COMMON)
        return kernel.at(over or size, *args, *size)

    def random_offsets(self, style: LoadedStyle[DeviceArray], size: Size, key: RandomKey) -> DeviceArray:
        """Uniformly random offsets, float32 (h, w, 2)."""
        out = self.device.empty((size[1], size[0], 2))
        args = (out, style.usable, *map(np.uint32, key_words(key)), *style.style.first_usable, *style.size)
        self.device.run(self._at(style, "random_offsets", size, *args))
        return out

    def render(
        self, style: LoadedStyle[DeviceArray], state: FrameState[DeviceArray], offsets: DeviceArray, votes: bool = False
    ) -> None:
        """Write the style colours at `offsets` into the frame; the margin continues the texture of border pixels.

        Args:
            votes: whether a colour is the mean of the colours that the patches around the pixel show there, instead of
                the colour at its own offset.
        """
        margin = 2 * style.energy.radius
        over = (state.size[0] + margin, state.size[1] + margin)
        args = (
            offsets, state.bins or self._placeholder, style.features, style.bins, self._cosines, state.packed,
            state.field, *style.size,
        )  # fmt: skip
        self.device.run(self._at(style, "render", state.size, *args, over=over, macros={"VOTES": int(votes)}))

    def add_change(
        self, style: LoadedStyle[DeviceArray], state: FrameState[DeviceArray], advected: DeviceArray, guides: Bytes,
        visible: DeviceArray,
    ) -> None:  # fmt: skip
        """Add the change of eq. 10 to the guides of the frame, where the neighbouring frame is visible.

        The guides then include `Tables.change_fraction` of the difference between the style at the advected offsets and
        the neighbouring frame, rounded and limited to 0..255.

        Args:
            advected: offsets of the neighbouring frame, advected to this one.
            guides: guides of the neighbouring frame, warped to this one, uint8 (h, w, channels).
            visible: uint8 (h, w): 0 = not visible in the neighbouring frame.
        """
        margin = 2 * style.energy.radius
        over = (state.size[0] + margin, state.size[1] + margin)
        change_fraction = self._tables(style.energy)[2]
        args = (advected, self.upload(guides), visible, style.features, change_fraction, state.packed, *style.size)
        self.device.run(self._at(style, "add_change", state.size, *args, over=over))

    def penalty(self, style: LoadedStyle[DeviceArray], size: Size, offsets: DeviceArray) -> DeviceArray:
        """Histogram penalty (eq. 8) of each style pixel: blurred number of uses in excess of the limit."""
        energy, (width, height) = style.energy, style.size
        counts = self.device.zeros((height, width), np.int32)
        rows, out = self.device.empty((height, width)), self.device.empty((height, width))
        mean_uses = max(1.0, size[0] * size[1] / _usable_area(style.style))
        threshold = np.float32(energy.h_limit * mean_uses)
        slope = np.float32(energy.w_h / mean_uses * tables(energy).centre)
        self.device.run(self._at(style, "count", size, offsets, counts, width, height))
        self.device.run(self._at(style, "blur_counts", style.size, counts, rows))
        self.device.run(self._at(style, "histogram_penalty", style.size, rows, out, threshold, slope))
        return out

    def improve(
        self, style: LoadedStyle[DeviceArray], state: FrameState[DeviceArray], offsets: DeviceArray,
        penalty: DeviceArray | None, search: Search,
    ) -> DeviceArray:  # fmt: skip
        """One PatchMatch iteration: the best offset of each pixel among neighbours, ribbons and random candidates."""
        out = self.device.empty((state.size[1], state.size[0], 2))
        self.costs = self.device.empty((state.size[1], state.size[0]))
        weights, tap_weights, _ = self._tables(style.energy)
        none = self._placeholder
        kernel = self.device.kernel(_PATCHES, "improve", self._terms(style, state, penalty), _COMMON)
        self.device.run(kernel.at(
            state.size, iteration(style, state.size, search), offsets, out, self.costs, state.packed, state.field,
            state.bins or none, style.features, style.bins, style.usable, style.distance, weights, style.tap_indices,
            self._cosines, style.tap_positions, tap_weights, state.advected_colours or none, penalty or none,
            state.distance or none, state.advected or none, state.ribbons or none, state.fixed or none,
            state.before or none,
        ))  # fmt: skip
        return out

    def _terms(
        self, style: LoadedStyle[DeviceArray], state: FrameState[DeviceArray], penalty: DeviceArray | None
    ) -> dict[str, int]:
        """Macros that select the energy terms compiled into the kernel; absent terms cost no time."""
        present = {
            "COHERENT": style.energy.w_sc > 0,
            "TEMPORAL": state.advected_colours is not None,
            "HISTOGRAM": penalty is not None,
            "LINES": state.distance is not None and style.style.distance is not None,
            "RIBBONS": state.ribbons is not None,
            "FIXED": state.fixed is not None,
            "SETTLES": state.before is not None,
        }
        shape = {"VECTORS": style.energy.vectors, "SCALE_SHIFT": SCALE_SHIFT}
        return self._defines(style) | shape | {name: int(used) for name, used in present.items()}

    def advect(
        self, style: LoadedStyle[DeviceArray], state: FrameState[DeviceArray], offsets: DeviceArray,
        bins: DeviceArray | None, displacement: DeviceArray, visible: DeviceArray,
    ) -> DeviceArray:  # fmt: skip
        """Advect the offsets of another frame to this one: nearest sample, extrapolated with both frames' directions.

        Args:
            offsets, bins: offsets and directions of the other frame.
            displacement: float32 (h, w, 2): from each pixel of this frame to its position in the other frame, px.
            visible: uint8 (h, w): 0 = not visible in the other frame.
        """
        out = self.device.empty((state.size[1], state.size[0], 2))
        args = (
            offsets, bins or self._placeholder, displacement, visible, style.bins, self._cosines, style.usable, out,
            *style.size,
        )  # fmt: skip
        self.device.run(self._at(style, "advect", state.size, *args))
        return out

    def upsample(
        self, coarse: LoadedStyle[DeviceArray], state: FrameState[DeviceArray], offsets: DeviceArray,
        style: LoadedStyle[DeviceArray], to: FrameState[DeviceArray],
    ) -> DeviceArray:  # fmt: skip
        """Upsample the offsets of the next coarser level by 2, extrapolated as in `advect`."""
        out = self.device.empty((to.size[1], to.size[0], 2))
        args = (
            offsets, state.bins or self._placeholder, coarse.bins, self._cosines, style.usable, out, *coarse.size,
            *state.size, *style.size,
        )  # fmt: skip
        self.device.run(self._at(style, "upsample_offsets", to.size, *args))
        return out

    def merge(
        self,
        style: LoadedStyle[DeviceArray],
        size: Size,
        first: DeviceArray,
        second: DeviceArray,
        probability: float | Plane,
        key: RandomKey,
    ) -> DeviceArray:
        """Random merge: the offset of `first` with the given probability, otherwise of `second`.

        If only one of the two has an offset at a pixel, that one is used.

        Args:
            probability: 0..1; float32 (h, w) = of each pixel.
        """
        biased = isinstance(probability, np.ndarray)
        out = self.device.empty((size[1], size[0], 2))
        args = (
            first,
            second,
            style.usable,
            out,
            self.upload(probability) if isinstance(probability, np.ndarray) else self._placeholder,
            np.float32(0 if isinstance(probability, np.ndarray) else probability),
            *map(np.uint32, key_words(key)),
            *style.style.first_usable,
            *style.size,
        )
        self.device.run(self._at(style, "merge", size, *args, macros={"BIASED": int(biased)}))
        return out

    def colours_at(self, style: LoadedStyle[DeviceArray], size: Size, offsets: DeviceArray) -> DeviceArray:
        """Style colours at the offsets, uint8 (h, w, 4); the fourth channel is 0 at pixels without an offset."""
        out = self.device.empty((size[1], size[0], 4), np.uint8)
        self.device.run(self._at(style, "colours_at", size, offsets, style.features, out, *style.size))
        return out

    def apply_fixed(
        self, style: LoadedStyle[DeviceArray], size: Size, fixed: DeviceArray, offsets: DeviceArray
    ) -> DeviceArray:
        """Overwrite `offsets` in place by the `fixed` offsets, at pixels that have one."""
        self.device.run(self._at(style, "apply_fixed", size, fixed, offsets))
        return offsets

    def antialiased(
        self, style: LoadedStyle[DeviceArray], state: FrameState[DeviceArray], offsets: DeviceArray,
        paintable: DeviceArray | None,
    ) -> DeviceArray:  # fmt: skip
        """Render the offsets of a frame between the pixels of the style, see `antialias`.

        Args:
            offsets: defined at every pixel.
            paintable: uint8 (h, w), 0 = the pixel may not be painted; None = all may be.

        Returns:
            uint8 (h, w, 3), or (h, w, 4) with straight alpha if the style has opacity.
        """
        (width, height), shape = state.size, (*style.style.colours.shape[:2], 4)
        channels = style.style.colours.shape[2]
        if style.colours is None:
            four = np.ones(shape, np.uint8)
            four[..., :channels] = style.style.colours
            style.colours = self.upload(four)
        out = self.device.empty((height, width, channels), np.uint8)
        macros = {
            "COLOURS": channels,
            "STEP_BITS": STEP_BITS,
            "STEPS": 1 << STEP_BITS,
            "ROTATE": int(style.style.bins is not None),
            "PARTIAL": int(paintable is not None),
        }
        kernel = self.device.kernel(_ANTIALIAS, "antialias", macros, _COMMON)
        none = self._placeholder
        self.device.run(kernel.at(
            state.size, offsets, state.bins or none, style.bins, self._cosines, self._cubic_taps, style.colours,
            paintable or none, out, *style.size, width, height,
        ))  # fmt: skip
        return out


def _usable_area(style: StyleImage) -> int:
    return style.size[0] * style.size[1] if style.usable is None else max(1, int(np.count_nonzero(style.usable)))
