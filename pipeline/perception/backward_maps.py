"""Warping of pictures of the previous frame to this one, where something moves."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Flow
from pipeline.kernels.jit import kernel
from pipeline.kernels.nonzero import nonzero_positions

BLOCK_PX = 32
"""Side of the blocks without any motion that `warp_back_enlarged` copies."""
WARPED_ROWS = 32
"""Rows of the whole width whose positions `warp_back_enlarged` computes at a time; more rows of narrower parts."""
MOST = 0.7
"""Share of moving pixels or blocks from which the whole frame is warped at once, which then costs less."""
MAP_COLUMNS = 256
"""Columns of the maps of single pixels: OpenCV's `remap` takes rows of up to 32767."""
_NO_SECOND_MAP = np.empty(0, np.float32)


class BackwardMaps(NamedTuple):
    """The pixels that move, and their positions in the previous frame as OpenCV's fixed-point maps (1/32 px).

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
    """Position of each moving pixel in the previous frame, or of all if most of them move, for `warp_back_mapped`.

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


def warp_back_mapped(image: NDArray[np.uint8], back: BackwardMaps) -> NDArray[np.uint8]:
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


def warp_back_enlarged(image: NDArray[np.uint8], flow: Flow) -> NDArray[np.uint8]:
    """`warp_back_mapped` of an image that is larger than the flow; each pixel moves as the nearest pixel of the flow.

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
