"""Refinement of a propagated segmentation: boundary correction, removal of misfits, merging, boundary smoothing."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.colour.lab8 import Lab8
from pipeline.frames import Labels
from pipeline.kernels.executors import INLINE, FrameExecutor
from pipeline.kernels.jit import kernel
from pipeline.kernels.nonzero import nonzero_positions
from pipeline.regions.regions import Means, Sums, colour_difference, means_of, move

BATCH = 512
"""Pixels that are processed together, so that the inner loops vectorise."""
NOISE = 5.0
"""CIELAB difference from a region's mean that never removes a pixel: camera noise and JPEG artefacts."""
LEAST_DISTINCT_PX = 8.0
"""Least area of a region that is kept because of its contrast."""
MIXTURE_DEVIATION = np.float32(0.3)
"""Largest distance of a mixture from the straight line between two colours, relative to their distance."""


@kernel
def correct(
    labels: Labels, lab: Lab8, limit: NDArray[np.uint8], sums: Sums, margin: float, slack: float
) -> Labels:  # fmt: skip
    """Correct propagated labels by colour.

    A boundary pixel moves to a 4-neighbouring region if its colour fits better by more than `margin`; the margin
    prevents noise from moving boundaries. A pixel that differs from its region's mean by more than `limit` * `slack`
    becomes unlabelled, so that what appears inside a region, such as in a fade, gets its own regions.

    Args:
        labels: int32 (h, w), 0 = unlabelled.
        limit: uint8 (h, w), growing limit, CIELAB units.
        sums: sums of the regions, updated.
        margin: CIELAB units.
        slack: factor on `limit`.

    Returns: the corrected labels, int32 (h, w).

    Departure: the paper does not correct labels, so a boundary that lags by a pixel would lag for ever.
    """
    out = labels.copy()
    _correct(labels, lab, limit, means_of(sums), sums, np.float32(margin), np.float32(slack), out)
    return out


@kernel
def _correct(
    labels: Labels, lab: Lab8, limit: NDArray[np.uint8], means: Means, sums: Sums, margin: np.float32,
    slack: np.float32, out: Labels,
) -> None:  # fmt: skip
    height, width = labels.shape
    there, made, colours = labels.reshape(labels.size), out.reshape(out.size), lab.reshape(labels.size, 3)
    most = limit.reshape(limit.size)
    lightness, red, yellow = means[:, 0].copy(), means[:, 1].copy(), means[:, 2].copy()
    light, a, b = np.empty(width, np.float32), np.empty(width, np.float32), np.empty(width, np.float32)
    unlike, places = np.empty(width, np.uint8), np.empty(width, np.int32)
    for y in range(height):
        row, colour, allowed = labels[y], lab[y].reshape(3 * width), limit[y]
        _mark_boundaries(row, labels[max(y - 1, 0)], labels[min(y + 1, height - 1)], unlike)
        for x in range(width):  # this and the next loop vectorise
            own = np.uint32(row[x])
            light[x], a[x], b[x] = lightness[own], red[own], yellow[own]
        for x in range(width):
            misfit = np.float32(allowed[x]) * slack
            misfit = misfit if misfit > np.float32(NOISE) else np.float32(NOISE)
            # Below the margin, no other region can fit better by more than the margin.
            least = margin if (unlike[x] != 0) & (margin < misfit) else misfit
            dl = (np.float32(colour[3 * x]) - light[x]) * np.float32(100.0 / 255.0)
            da, db = np.float32(colour[3 * x + 1]) - a[x], np.float32(colour[3 * x + 2]) - b[x]
            unlike[x] = np.uint8((dl * dl + da * da + db * db > least * least) & (row[x] != 0))
        for at in places[: nonzero_positions(unlike, places, y * width)]:
            place, x = np.uint64(at), at - y * width  # Numba would test a signed index for its sign
            own = there[place]
            error = colour_difference(colours, at, means, own)
            best, to = error - margin, own
            for step, inside in ((-width, y > 0), (-1, x > 0), (1, x < width - 1), (width, y < height - 1)):
                other = there[np.uint64(at + step)] if inside else own
                if other == own or other == 0:
                    continue
                difference = colour_difference(colours, at, means, other)
                if difference < best:
                    best, to = difference, other
            if to == own and error > max(most[place] * slack, np.float32(NOISE)):
                to = np.int32(0)
            if to != own:
                made[place] = to
                move(sums, colours, most, at, own, to)


@kernel
def _mark_boundaries(
    row: NDArray[np.int32], above: NDArray[np.int32], below: NDArray[np.int32], out: NDArray[np.uint8]
) -> None:  # fmt: skip
    """Mark, in a row of labels, the pixels beside or below or above which there is another region: 1, otherwise 0."""
    width = row.size
    for x in range(width):  # this and the next loop vectorise
        own, over, under = row[x], above[x], below[x]
        out[x] = np.uint8(((over != own) & (over != 0)) | ((under != own) & (under != 0)))
    for x in range(1, width - 1):
        own, left, right = row[x], row[x - 1], row[x + 1]
        out[x] |= np.uint8(((left != own) & (left != 0)) | ((right != own) & (right != 0)))
    for x, beside in ((0, min(1, width - 1)), (width - 1, max(width - 2, 0))):
        out[x] |= np.uint8((row[beside] != row[x]) & (row[beside] != 0))


@kernel
def add_regions(
    labels: Labels, lab: Lab8, limit: NDArray[np.uint8], sums: Sums, pixels: NDArray[np.int32], first_new: int,
    slack: float,
) -> int:  # fmt: skip
    """Add new regions to `sums`, and release the pixels that do not fit their region; in place.

    A pixel is released (label 0) if it differs from the mean of its new region by more than `limit` * `slack`. If the
    mean lies between two colours and fits no pixel, the colour of the most similar pixel is used instead.

    Args:
        pixels: flat indices of all pixels that may belong to a new region.
        first_new: smallest label of a new region.

    Returns: number of released pixels.
    """
    _add_pixels(labels, lab, limit, sums, pixels, first_new)
    means = means_of(sums)
    _use_nearest_colours(labels, lab, limit, means, pixels, first_new, np.float32(slack))
    return _release(labels, lab, limit, means, sums, pixels, first_new, np.float32(slack))


@kernel
def _add_pixels(
    labels: Labels, lab: Lab8, limit: NDArray[np.uint8], sums: Sums, pixels: NDArray[np.int32], first_new: int
) -> None:  # fmt: skip
    there, colours, most = labels.reshape(labels.size), lab.reshape(labels.size, 3), limit.reshape(limit.size)
    for at in pixels:
        if there[at] >= first_new:
            move(sums, colours, most, at, 0, there[at])


@kernel
def _use_nearest_colours(
    labels: Labels, lab: Lab8, limit: NDArray[np.uint8], means: Means, pixels: NDArray[np.int32], first_new: int,
    slack: np.float32,
) -> None:  # fmt: skip
    there, colours, most = labels.reshape(labels.size), lab.reshape(labels.size, 3), limit.reshape(limit.size)
    count = means.shape[0]
    least = np.full(count, np.float32(1e9))
    nearest = np.zeros(count, np.int32)
    for at in pixels:
        label = there[at]
        if label < first_new:
            continue
        over = colour_difference(colours, at, means, label) - max(most[at] * slack, np.float32(NOISE))
        if over < least[label]:
            least[label], nearest[label] = over, at
    for label in range(first_new, count):
        if 0 < least[label] < np.float32(1e9):
            for c in range(3):
                means[label, c] = colours[nearest[label], c]


@kernel
def _release(
    labels: Labels, lab: Lab8, limit: NDArray[np.uint8], means: Means, sums: Sums, pixels: NDArray[np.int32],
    first_new: int, slack: np.float32,
) -> int:  # fmt: skip
    there, colours, most = labels.reshape(labels.size), lab.reshape(labels.size, 3), limit.reshape(limit.size)
    freed = 0
    for at in pixels:
        label = there[at]
        if label < first_new:
            continue
        if colour_difference(colours, at, means, label) > max(most[at] * slack, np.float32(NOISE)):
            there[at] = 0
            move(sums, colours, most, at, label, 0)
            freed += 1
    return freed


@kernel
def merge_table(
    labels: Labels, means: Means, areas: NDArray[np.int64], smallest: NDArray[np.int32], thinnest: float,
    first_alike: int, similar: np.float32, distinct: np.float32,
) -> NDArray[np.int32]:  # fmt: skip
    """Label that each region is merged into, or its own label: int32 (regions + 1,).

    The candidate is the neighbour with the most similar mean colour among the larger ones. A region is merged into it

    - within `similar` CIELAB units, if its label is at least `first_alike`;
    - if its area is below `smallest`. If the candidate differs by more than `distinct` CIELAB units, this limit falls
      in inverse proportion to the difference, to `LEAST_DISTINCT_PX` at least;
    - if it is narrower than `thinnest` px, and its colour is a mixture of the candidate's and another neighbour's: a
      sliver along a blurred or moving edge.

    All regions may merge, old and new ones: otherwise those that a moving camera makes would add up. It does not make
    them pop: a region is made only where pixels differ by far more than `similar`.

    Departure: zhang2011online does not merge regions.
    """
    count = means.shape[0]
    best = np.full(count, np.float32(1e9))
    target = np.arange(count).astype(np.int32)
    lengths = np.zeros(count, np.int64)
    places = _border_places(labels)
    height, width = labels.shape
    for at in places:
        y, x = at // width, at % width
        own = labels[y, x]
        for other in (labels[y, min(x + 1, width - 1)], labels[min(y + 1, height - 1), x]):
            if other == own:
                continue
            lengths[own] += 1
            lengths[other] += 1
            one, two = (own, other) if _may_merge_into(own, other, areas) else (other, own)
            distance = _distance(means, one, two)
            if distance < best[one]:
                best[one], target[one] = distance, two
    sliver = np.zeros(count, np.bool_)
    for label in range(count):
        sliver[label] = 2 * areas[label] < thinnest * lengths[label]
    mixed = np.zeros(count, np.bool_)
    for at in places:
        y, x = at // width, at % width
        own = labels[y, x]
        for other in (labels[y, min(x + 1, width - 1)], labels[min(y + 1, height - 1), x]):
            for one, two in ((own, other), (other, own)):
                if one != two and sliver[one] and not mixed[one] and target[one] != one:
                    mixed[one] = _is_mixture(means, target[one], one, two)
    for label in range(count):
        limit = np.float32(smallest[label])
        if best[label] > distinct:
            limit = max(limit * distinct / best[label], min(limit, np.float32(LEAST_DISTINCT_PX)))
        apart = best[label] >= similar or label < first_alike
        if apart and areas[label] >= limit and not mixed[label]:
            target[label] = label
    for label in range(count):
        end = label
        while target[end] != end:
            end = target[end]
        target[label] = end
    return target


@kernel
def _border_places(labels: Labels) -> NDArray[np.int32]:
    """Flat indices of the pixels with another region to their right or below them."""
    height, width = labels.shape
    edge, found = np.zeros(width, np.uint8), np.empty(labels.size, np.int32)
    count = 0
    for y in range(height):
        row, low = labels[y], labels[min(y + 1, height - 1)]
        for x in range(width - 1):  # this vectorises
            edge[x] = np.uint8((row[x] != row[x + 1]) | (row[x] != low[x]))
        edge[width - 1] = row[width - 1] != low[width - 1]
        count = nonzero_positions(edge, found, y * width, count)
    return found[:count]


@kernel
def _distance(means: Means, one: int, two: int) -> np.float32:
    """CIELAB distance of two mean colours."""
    dl = (means[one, 0] - means[two, 0]) * np.float32(100.0 / 255.0)
    da, db = means[one, 1] - means[two, 1], means[one, 2] - means[two, 2]
    return np.float32(np.sqrt(dl * dl + da * da + db * db))


@kernel
def _is_mixture(means: Means, one: int, between: int, two: int) -> bool:
    """Whether the colour `between` lies about on the line between the colours `one` and `two`."""
    square = along = off = np.float32(0)
    for c in range(3):
        span, part = means[two, c] - means[one, c], means[between, c] - means[one, c]
        square += span * span
        along += span * part
        off += part * part
    share = along / max(square, np.float32(1))
    return bool(0 < share < 1 and off - along * share <= MIXTURE_DEVIATION * MIXTURE_DEVIATION * square)


@kernel
def _may_merge_into(one: int, two: int, areas: NDArray[np.int64]) -> bool:
    """Strict order that prevents cyclic merges: smaller regions into larger ones, of equal ones newer into older
    ones."""
    return areas[one] < areas[two] or (areas[one] == areas[two] and one > two)


def round_boundaries(labels: Labels, radius_px: float, background: FrameExecutor = INLINE) -> Labels:
    """Smooth region boundaries without gaps: each pixel takes the majority label of the disc around it.

    A pixel keeps its label if half of the disc has it, and in ties. Discs with a radius of at least 3 px are sampled at
    every second pixel and row. Border pixels are replicated.

    Source: zhang2011online, section 3.
    """
    reach = int(radius_px)
    ys, xs = _samples(radius_px)
    padded = cv2.copyMakeBorder(labels, reach, reach, reach, reach, cv2.BORDER_REPLICATE)
    out = labels.copy()
    around = np.asarray(padded, np.int32)
    background.rows(lambda first, last: _majority(around, ys, xs, reach, out, first, last), len(out))
    return out


@lru_cache(maxsize=8)
def _samples(radius_px: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Offsets (ys, xs) of the samples of a disc."""
    reach = int(radius_px)
    stride = 1 if reach < 3 else 2
    ys, xs = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    inside = (xs**2 + ys**2 <= radius_px**2) & (xs % stride == 0) & (ys % stride == 0)
    return ys[inside].astype(np.int64), xs[inside].astype(np.int64)


@kernel
def _majority(
    padded: Labels, ys: NDArray[np.int64], xs: NDArray[np.int64], reach: int, out: Labels, first: int, last: int
) -> None:  # fmt: skip
    width = out.shape[1]
    total = ys.size
    mine = np.empty(width, np.int32)
    places = np.empty(BATCH + width, np.int32)
    few = 0
    for y in range(first, last):
        own = padded[y + reach, reach : reach + width]
        mine[:] = total % 2
        for n in range(0, total - 1, 2):  # whole rows at a time: this vectorises; the centre always agrees
            at, to = n + (n >= total // 2), n + 1 + (n + 1 >= total // 2)
            one = padded[y + reach + ys[at], reach + xs[at] : reach + xs[at] + width]
            two = padded[y + reach + ys[to], reach + xs[to] : reach + xs[to] + width]
            for x in range(width):
                mine[x] += np.int32(one[x] == own[x]) + np.int32(two[x] == own[x])
        for x in range(width):
            places[few] = y * width + x
            few += 2 * mine[x] < total  # otherwise no other label can have more
        if few >= BATCH or y == last - 1:
            _elect(padded, ys, xs, reach, places[:few], out)
            few = 0


@kernel
def _elect(
    padded: Labels, ys: NDArray[np.int64], xs: NDArray[np.int64], reach: int, places: NDArray[np.int32], out: Labels
) -> None:  # fmt: skip
    """Write the most frequent label of the disc around each place; in ties the pixel's own, otherwise the first."""
    total, count, width = ys.size, places.size, out.shape[1]
    there, made = padded.reshape(padded.size), out.reshape(out.size)
    around = np.empty((total, count), np.int32)
    centres = np.empty(count, np.int32)
    for k in range(count):
        y = places[k] // width
        centres[k] = (y + reach) * padded.shape[1] + places[k] - y * width + reach
    for n in range(total):
        step = ys[n] * padded.shape[1] + xs[n]
        for k in range(count):
            around[n, k] = there[np.uint64(centres[k] + step)]  # Numba would test a signed index for its sign
    label = np.empty(count, np.int32)
    most = np.zeros(count, np.int32)
    for k in range(count):
        label[k] = there[centres[k]]
    for n in range(total):
        for k in range(count):
            most[k] += np.int32(around[n, k] == label[k])
    votes = np.empty(count, np.int32)
    for n in range(total):
        votes[:] = 0
        for m in range(total):  # over all places at a time: this vectorises
            for k in range(count):
                votes[k] += np.int32(around[n, k] == around[m, k])
        for k in range(count):
            better = votes[k] > most[k]
            label[k] = around[n, k] if better else label[k]
            most[k] = votes[k] if better else most[k]
    for k in range(count):
        made[places[k]] = label[k]
