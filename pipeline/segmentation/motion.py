"""Motion for label propagation: detection of still pixels, and temporal denoising along the motion.

Departure: neither is part of zhang2011online. Without them, sensor noise moves the regions of a still scene.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import AnyArray
from pipeline.background import INLINE, Background
from pipeline.colour.lab8 import LabPlanes
from pipeline.frames import Flow, Frame
from pipeline.jit import kernel
from pipeline.nonzero import nonzero_positions
from pipeline.segmentation.regions import Lab8
from pipeline.selection import column_medians

BLOCK_PX = 32
"""Side of the blocks without any motion that `warp_enlarged` copies."""
WARPED_ROWS = 32
"""Rows of the whole width whose positions `warp_enlarged` computes at a time; more rows of narrower parts."""
MOST = 0.7
"""Share of moving pixels or blocks from which the whole frame is warped at once, which then costs less."""
MAP_COLUMNS = 256
"""Columns of the maps of single pixels: OpenCV's `remap` takes rows of up to 32767."""
RESIDUAL_STEPS = 4
"""Steps of a residual per CIELAB unit."""
FAR = 255
"""Residual of a pixel without counterpart in the previous frame."""
SPECK = np.ones((3, 3), np.uint8)
"""Largest speck that `closed_residual` removes."""
FADE_TOLERANCE = 10.0
"""Residual, CIELAB units, at which the weight of the previous output has fallen to 1/e."""


def median_motion(flow: NDArray[np.float32]) -> NDArray[np.float32]:
    """Median of vectors (..., 2), px, separately for x and y; the upper median for an even number: float32 (2,)."""
    return column_medians(flow)


def zero_still_flow(
    flow: Flow, previous_gray: NDArray[np.uint8], gray: NDArray[np.uint8], tolerance: float,
    moving: NDArray[np.uint8] | None = None,
) -> Flow:  # fmt: skip
    """Set the flow of still pixels to exactly 0, in place; returns it: float32 (h, w, 2), px.

    A pixel is still if the mean absolute difference of the two frames over 5x5 px is at most `tolerance`, or if its
    displacement is less than a tenth of a pixel.

    Args:
        previous_gray, gray: uint8 (h, w).
        tolerance: gray levels, 0..255.
        moving: uint8 (h, w); where it is not 0, only the displacement counts. None = 0 everywhere.
    """
    difference = np.asarray(cv2.boxFilter(cv2.absdiff(gray, previous_gray), -1, (5, 5)), np.uint8)
    if moving is not None:
        difference = np.asarray(np.where(moving, np.uint8(255), difference), np.uint8)
    _zero_still(flow, difference, np.uint8(tolerance))
    return flow


@kernel
def _zero_still(flow: Flow, difference: NDArray[np.uint8], tolerance: np.uint8) -> None:
    height, width = difference.shape
    for y in range(height):
        pairs, changes = flow[y].reshape(2 * width), difference[y]
        for x in range(width):  # this vectorises
            dx, dy = pairs[2 * x], pairs[2 * x + 1]
            still = (changes[x] <= tolerance) | (dx * dx + dy * dy < 0.01)
            pairs[2 * x] = np.float32(0) if still else dx
            pairs[2 * x + 1] = np.float32(0) if still else dy


_NO_SECOND_MAP = np.empty(0, np.float32)


class BackwardMaps(NamedTuple):
    """Where something moves, and OpenCV's fixed-point maps (1/32 px) to the previous frame.

    Attributes:
        places: int32 (n,), flat indices of the moving pixels.
        lost: int32 (m,), flat indices of those that come from outside the previous frame.
        complete: whether the maps are of all pixels, in the shape of the frame, and not of the moving ones alone.
        whole: int16 (rows, columns, 2), position of each pixel in the previous frame, whole pixels.
        fractions: uint16 (rows, columns), fractions of the position.
    """

    places: NDArray[np.int32]
    lost: NDArray[np.int32]
    complete: bool
    whole: NDArray[np.int16]
    fractions: NDArray[np.uint16]


def backward_maps(flow: Flow) -> BackwardMaps:
    """Position of each moving pixel in the previous frame, or of all if most of them move, for `warp_back`.

    Args:
        flow: float32 (h, w, 2), px.
    """
    height, width = flow.shape[:2]
    rows = -(-height * width // MAP_COLUMNS)
    whole, fractions = np.empty((rows, MAP_COLUMNS, 2), np.int16), np.empty((rows, MAP_COLUMNS), np.uint16)
    places, lost = np.empty(fractions.size + width, np.int32), np.empty(height * width + width, np.int32)
    count, outside = _moving_maps(flow, (whole, fractions), places, lost)
    places, lost = places[:count], lost[:outside]
    if count > MOST * height * width:
        whole, fractions = np.empty((height, width, 2), np.int16), np.empty((height, width), np.uint16)
        _whole_maps(flow, whole, fractions)
        return BackwardMaps(places, lost, True, whole, fractions)
    rows = -(-count // MAP_COLUMNS)
    return BackwardMaps(places, lost, False, whole[:rows], fractions[:rows])


@kernel
def _moving_maps(
    flow: Flow, maps: tuple[NDArray[np.int16], NDArray[np.uint16]], places: NDArray[np.int32], lost: NDArray[np.int32]
) -> tuple[int, int]:  # fmt: skip
    """Write the flat indices of the moving pixels, their maps one after the other, and the indices of those that come
    from outside; returns the numbers of both. The maps' last row is filled up with zeros."""
    height, width = flow.shape[0], flow.shape[1]
    whole, fractions = maps[0].view(np.int32).reshape(maps[1].size), maps[1].reshape(maps[1].size)
    moving, outside = np.empty(width, np.uint8), np.empty(width, np.uint8)
    row_whole, row_fractions = np.empty(2 * width, np.int16), np.empty(width, np.uint16)
    pairs = row_whole.view(np.int32)
    right, below = np.float32(width - 1), np.float32(height - 1)
    count = gone = 0
    for y in range(height):
        moves = flow[y].reshape(2 * width)
        if is_still(moves):
            continue
        _row_maps(moves, y, row_whole, row_fractions)
        for x in range(width):  # this vectorises
            dx, dy = moves[2 * x], moves[2 * x + 1]
            left, top = np.float32(x) - dx, np.float32(y) - dy
            moving[x] = np.uint8((dx != 0.0) | (dy != 0.0))
            outside[x] = np.uint8((left < 0) | (top < 0) | (left > right) | (top > below))
        first, count = count, nonzero_positions(moving, places, y * width, count)
        gone = nonzero_positions(outside, lost, y * width, gone)
        for k in range(first, count):
            x = places[k] - y * width
            whole[k], fractions[k] = pairs[x], row_fractions[x]
    for k in range(count, min(-(-count // MAP_COLUMNS) * MAP_COLUMNS, fractions.size)):
        whole[k], fractions[k] = np.int32(0), np.uint16(0)
    return count, gone


@kernel
def is_still(moves: NDArray[np.float32]) -> bool:
    """Whether all components of a flow, float32 (n,), are exactly 0."""
    moving = False
    for k in range(moves.size):  # this vectorises
        moving |= moves[k] != 0.0
    return not moving


@kernel
def _row_maps(moves: NDArray[np.float32], y: int, whole: NDArray[np.int16], fractions: NDArray[np.uint16]) -> None:
    """Fill the maps of row `y` as `cv2.convertMaps` does."""
    for x in range(fractions.size):  # this vectorises
        across = np.int32(np.rint((np.float32(x) - moves[2 * x]) * np.float32(32)))
        down = np.int32(np.rint((np.float32(y) - moves[2 * x + 1]) * np.float32(32)))
        whole[2 * x], whole[2 * x + 1] = np.int16(across >> 5), np.int16(down >> 5)
        fractions[x] = np.uint16(((down & 31) << 5) | (across & 31))


@kernel
def _whole_maps(flow: Flow, whole: NDArray[np.int16], fractions: NDArray[np.uint16]) -> None:
    height, width = fractions.shape
    for y in range(height):
        _row_maps(flow[y].reshape(2 * width), y, whole[y].reshape(2 * width), fractions[y])


def _moving_spans(flow: Flow) -> list[tuple[slice, slice]]:
    """Rows and columns of blocks next to each other in which something moves; the whole frame if most of it moves."""
    height, width = flow.shape[:2]
    blocks = _moving_blocks(flow)
    return [_everything(flow)] if blocks.mean() > MOST else block_spans(blocks, (width, height))


def block_spans(blocks: NDArray[np.int8], size: tuple[int, int]) -> list[tuple[slice, slice]]:
    """Rows and columns, px, of marked blocks of `BLOCK_PX` next to each other, one row of blocks after the other.

    Args:
        blocks: int8 (rows, columns), 1 for a marked block, else 0.
        size: (width, height) of the frame, px; the last blocks are cut off there.
    """
    width, height = size
    bordered = np.pad(blocks, ((0, 0), (1, 1)))
    rows, columns = np.nonzero(bordered[:, 1:] != bordered[:, :-1])  # of each row, where its spans begin and end
    return [
        (
            slice(row * BLOCK_PX, min((row + 1) * BLOCK_PX, height)),
            slice(first * BLOCK_PX, min(last * BLOCK_PX, width)),
        )
        for row, first, last in zip(rows[::2].tolist(), columns[::2].tolist(), columns[1::2].tolist(), strict=True)
    ]


def _everything(flow: Flow) -> tuple[slice, slice]:
    return slice(0, flow.shape[0]), slice(0, flow.shape[1])


def scaled_span(span: slice, scale: float) -> slice:
    """A span on a grid of `scale` times as many pixels."""
    return slice(round(scale * span.start), round(scale * span.stop))


@kernel
def _moving_blocks(flow: Flow) -> NDArray[np.int8]:
    """1 for each block of `BLOCK_PX` that has a pixel whose flow is not 0, else 0: int8 (rows, columns)."""
    height, width = flow.shape[0], flow.shape[1]
    blocks = np.zeros((-(-height // BLOCK_PX), -(-width // BLOCK_PX)), np.int8)
    for y in range(height):
        for column in range(blocks.shape[1]):
            if blocks[y // BLOCK_PX, column]:
                continue
            part = flow[y, column * BLOCK_PX : (column + 1) * BLOCK_PX]
            moves = False
            for x in range(part.shape[0]):
                moves |= (part[x, 0] != 0.0) | (part[x, 1] != 0.0)
            blocks[y // BLOCK_PX, column] = moves
    return blocks


def warp_back(image: NDArray[np.uint8], back: BackwardMaps) -> NDArray[np.uint8]:
    """Warp an image of the previous frame, uint8 (h, w, 3), to this frame; bilinear, border pixels are replicated."""
    if not back.places.size:
        return image.copy()
    moved = cv2.remap(image, back.whole, back.fractions, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    if back.complete:
        return np.asarray(moved, np.uint8)
    out = image.copy()
    _scatter(np.asarray(moved, np.uint8), back.places, out)
    return out


@kernel
def _scatter(moved: NDArray[np.uint8], places: NDArray[np.int32], out: NDArray[np.uint8]) -> None:
    """Write the first pixels of `moved` to these places."""
    pixels, there = moved.reshape(moved.size), out.reshape(out.size)
    for k in range(places.size):
        at = 3 * places[k]
        there[at], there[at + 1], there[at + 2] = pixels[3 * k], pixels[3 * k + 1], pixels[3 * k + 2]


def warp_enlarged(image: NDArray[np.uint8], flow: Flow) -> NDArray[np.uint8]:
    """`warp_back` of an image that is larger than the flow; each pixel moves as the nearest pixel of the flow.

    The positions are computed for some rows at a time, which stay in the processor's cache.

    Args:
        image: of the previous frame, uint8 (h, w, 3).
        flow: float32 (rows, columns, 2), px of the flow's grid.
    """
    height, width = image.shape[:2]
    own_rows, own_columns = flow.shape[:2]
    down, across = height / own_rows, width / own_columns
    near_row, near_column = np.arange(height) * own_rows // height, np.arange(width) * own_columns // width
    spans = _moving_spans(flow)
    out = np.empty_like(image) if spans == [_everything(flow)] else image.copy()
    memory = np.empty((WARPED_ROWS * width, 2), np.float32)
    for rows, columns in spans:
        rows, columns = scaled_span(rows, down), scaled_span(columns, across)
        at_once = WARPED_ROWS * width // (columns.stop - columns.start)
        for top in range(rows.start, rows.stop, at_once):
            band = out[top : min(top + at_once, rows.stop), columns]
            where = memory[: band.shape[0] * band.shape[1]].reshape(*band.shape[:2], 2)
            nearest = near_row[top : top + len(band)], near_column[columns]
            _positions(flow, nearest, (np.float32(across), np.float32(down)), (columns.start, top), where)
            cv2.remap(image, where, _NO_SECOND_MAP, cv2.INTER_LINEAR, dst=band, borderMode=cv2.BORDER_REPLICATE)
    return out


@kernel
def _positions(
    flow: Flow, nearest: tuple[NDArray[np.int64], NDArray[np.int64]], scales: tuple[np.float32, np.float32],
    corner: tuple[int, int], where: NDArray[np.float32],
) -> None:  # fmt: skip
    """Fill `where` with the positions, in the previous image, of the pixels of a part whose first one is at `corner`
    (x, y). `nearest`: for each row and column of the part, that of the flow."""
    rows, columns = nearest
    across, down = scales
    left, top = corner
    for y in range(rows.size):
        moves = flow[rows[y]]
        for x in range(columns.size):
            where[y, x, 0] = np.float32(left + x) - moves[columns[x], 0] * across
            where[y, x, 1] = np.float32(top + y) - moves[columns[x], 1] * down


def denoise(
    lab: LabPlanes, denoised: Lab8, flow: Flow, back: BackwardMaps, memory: float, tolerance: float
) -> tuple[LabPlanes, NDArray[np.uint8]]:  # fmt: skip
    """Average the still pixels of a frame with the denoised previous frame, where the two agree.

    Moving pixels stay as they are: repeated bilinear sampling along an inexact flow would blur them, and hardly makes
    regions steadier (without it, flicker of 15 clips falls by up to 3.5 % in 11 and rises by 0.2 to 2.2 % in 4; detail
    rises by up to 3 %).

    Args:
        lab: current frame, uint8 (3, h, w).
        denoised: result for the previous frame, uint8 (h, w, 3).
        flow: previous to current frame, float32 (h, w, 2), px; read at the target, since flow varies slowly.
        back: `backward_maps(flow)`.
        memory: weight of the past for pixels without difference, 0..0.95.
        tolerance: CIELAB difference at which the weight has fallen to 1/e.

    Returns:
        The denoised frame, uint8 (3, h, w), and the residual, uint8 (h, w): CIELAB difference to the bilinear sample of
        the past in quarter units; 255 = at least 63.75, or no counterpart.
    """
    size = lab[0].size
    mixed = np.empty_like(lab)
    cv2.split(warp_back(denoised, back), list(mixed))
    here, past = lab.reshape(3, size), mixed.reshape(3, size)  # by plane, these loops vectorise
    residual = np.empty(lab.shape[1:], np.uint8)
    weights = np.empty(lab.shape[1:], np.int16)
    _difference(here, past, residual.ravel())
    _weigh(_weights(memory, tolerance).astype(np.int16), residual, weights)
    _fill_places(weights, back.places, 0)
    _fill_places(residual, back.lost, FAR)
    _mix(here, past, weights.ravel())
    return mixed, residual


def blend_with_past(
    picture: Frame, past: Frame, residual: NDArray[np.uint8], memory: float, background: Background = INLINE
) -> Frame:  # fmt: skip
    """Blend an output with the previous output where the source agrees with its past, so that changes fade in.

    Args:
        picture: uint8 (h, w, 3), this output.
        past: the previous output, warped to this frame (`warp_back`); overwritten with the result.
        residual: residual of the source, see `denoise`.
        memory: weight of the previous output where the residual is 0, 0..0.95; it falls to 1/e at `FADE_TOLERANCE`.

    Returns: `past`, uint8 (h, w, 3).
    """
    weights = past_weights(memory)
    background.rows(
        lambda first, last: _fade(picture[first:last], past[first:last], residual[first:last], weights), len(picture)
    )
    return past


def closed_residual(residual: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The residual without the specks of small values among large ones (a morphological closing): uint8 (h, w).

    Where something moves away, single pixels of what was hidden look by chance like their past. With the previous
    output there, an orange hand would leave orange specks on the window behind it for several frames.
    """
    return np.asarray(cv2.morphologyEx(residual, cv2.MORPH_CLOSE, SPECK), np.uint8)


def past_weights(memory: float) -> NDArray[np.int32]:
    """Weight of the previous frame's colours by residual (see `denoise`), int32 (256,), 256 = 1.

    Args:
        memory: weight at residual 0, 0..0.95; it falls to 1/e at `FADE_TOLERANCE`.
    """
    return _weights(memory, FADE_TOLERANCE)


@lru_cache(maxsize=64)
def _weights(memory: float, tolerance: float) -> NDArray[np.int32]:
    """Weight of the past by residual: int32 (256,), 256 = 1."""
    difference = np.arange(256) / RESIDUAL_STEPS
    weights = memory * np.exp(-((difference / tolerance) ** 2))
    weights[FAR] = 0
    return np.rint(weights * 256).astype(np.int32)


@kernel
def _difference(now: NDArray[np.uint8], past: NDArray[np.uint8], residual: NDArray[np.uint8]) -> None:
    """Write the CIELAB difference in quarter units, at most 254."""
    for k in range(residual.size):
        dl = np.int32(past[0, k]) - np.int32(now[0, k])
        da = np.int32(past[1, k]) - np.int32(now[1, k])
        db = np.int32(past[2, k]) - np.int32(now[2, k])
        # In sixteenths of a squared unit: L is scaled by 255/100, hence its square by 630/256/16.
        square = min(np.int32(65024), ((630 * dl * dl) >> 8) + 16 * (da * da + db * db))
        residual[k] = np.uint8(np.sqrt(np.float32(square)))


@kernel
def _weigh(still: NDArray[np.int16], residual: NDArray[np.uint8], weights: NDArray[np.int16]) -> None:
    """Write the weight of the past, 256 = 1, as if no pixel moved. `still`: weight by residual."""
    apart, out = residual.reshape(residual.size), weights.reshape(weights.size)
    for k in range(apart.size):
        out[k] = still[apart[k]]


@kernel
def _fill_places(plane: AnyArray, places: NDArray[np.int32], value: int) -> None:
    """Write a value at these flat indices."""
    flat = plane.reshape(plane.size)
    for k in range(places.size):
        flat[np.uint64(places[k])] = value


@kernel
def _mix(now: NDArray[np.uint8], past: NDArray[np.uint8], weights: NDArray[np.int16]) -> None:
    """Overwrite `past` with the average."""
    for plane in range(3):
        a, b = now[plane], past[plane]
        for k in range(weights.size):
            b[k] = np.uint8(a[k] + ((np.int32(weights[k]) * (np.int32(b[k]) - np.int32(a[k])) + 128) >> 8))


@kernel
def _fade(picture: Frame, past: Frame, residual: NDArray[np.uint8], weights: NDArray[np.int32]) -> None:
    """Overwrite `past` with the blend."""
    height, width = residual.shape
    by_byte = np.empty(3 * width, np.int32)
    for y in range(height):
        for x in range(width):
            by_byte[3 * x] = by_byte[3 * x + 1] = by_byte[3 * x + 2] = weights[residual[y, x]]
        now, then = picture[y].reshape(by_byte.size), past[y].reshape(by_byte.size)
        for k in range(by_byte.size):  # this vectorises
            then[k] = np.uint8(now[k] + ((by_byte[k] * (np.int32(then[k]) - np.int32(now[k])) + 128) >> 8))
