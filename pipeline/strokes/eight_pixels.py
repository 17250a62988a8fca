"""The inner loops of `streamlines_forward`, eight pixels of a row at a time.

Rows of a stroke are nine pixels long on average, so that the vectors which a compiler makes of a loop would seldom be
full. Arrays are flat, and have `LANES` spare pixels at their end, those of a bounding box at the end of each row.
"""

from __future__ import annotations

import math
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from pipeline.intrinsics import LANES, Arguments, Intrinsic, Vectors
from pipeline.strokes.bristles import SUBROWS

TIP, PER_TIP = np.float32(0.3), np.float32(1 / 0.3)
"""Share of a stroke's length in which it tapers, at either end."""

Boxes = tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]
"""Per pixel of a stroke's bounding box: coverage, position along the stroke, px, and across it, -1..1. After `Shade`:
opacity, shade of the bristles in gray levels, and share of the paint's height."""
Floats = tuple[np.float32, ...]
Pixel = TypeVar("Pixel", np.uint8, np.bool_)
_ONE, _ZERO, _HALF = np.float32(1), np.float32(0), np.float32(0.5)


def with_spare(picture: NDArray[Pixel]) -> NDArray[Pixel]:
    """A copy of a picture, (h, w) or (h, w, channels), with memory for `LANES` further pixels behind it."""
    channels = math.prod(picture.shape[2:])
    flat = np.zeros(picture.size + LANES * channels, picture.dtype)
    made = flat[: picture.size].reshape(picture.shape)
    made[...] = picture
    return made


class Cover(Intrinsic):
    """`cover(boxes, at, finished, pixel, x, count, segment, ends)`: cover pixels by a segment of a stroke.

    A pixel at s px along the segment and t px across it is covered by c = (w - d) sharp + 1/2, at most 1, where d is
    its distance from the segment and w the half width of the stroke there. Where c exceeds the coverage by the
    stroke's other segments, it replaces it, and the position in the stroke with it.

    Args:
        tapers: whether the width varies along the segment.

    Args of the call:
        at: index of the first pixel in `boxes`.
        finished: bool (n,), pixels that are left out.
        pixel: index of the first pixel there.
        x: its column, px.
        count: number of pixels, at least 1; those beyond the eighth are left out.
        segment: its start x; its direction x, y; s and -t of the row at the column of its start, px; its length, px;
            length of the stroke before it, px; 1 / length of the stroke; radius, px; 1 / radius; how much the stroke's
            start and its end taper, 0..1; sharp, 1/px.
        ends: whether the stroke ends here; otherwise the joint of the next segment covers what lies beyond.

    Returns:
        First and last of the eight pixels that were covered; 8 and -1 if there is none.
    """

    def __init__(self, tapers: bool) -> None:
        self._tapers = tapers

    def __call__(
        self, boxes: Boxes, at: int, finished: NDArray[np.bool_], pixel: int, x: int, count: int, segment: Floats,
        ends: bool,
    ) -> tuple[int, int]:  # fmt: skip
        x0, ax, ay, s_row, t_row, length, before, part, r, per_r, taper_start, taper_end, sharp = segment
        first, last = LANES, -1
        for lane in range(min(count, LANES)):
            fx = np.float32(x + lane) - x0
            s, t = fx * ax + s_row, t_row - fx * ay
            if finished[pixel + lane] or (s > length and not ends):
                continue
            p = min(max(s, _ZERO), length)
            d, w = np.sqrt((s - p) * (s - p) + t * t), r
            if self._tapers:
                u = (before + p) * part
                q, v = max(_ONE - u * PER_TIP, _ZERO), max(_ONE - (_ONE - u) * PER_TIP, _ZERO)
                w = r * (_ONE - (taper_start * q * q + taper_end * v * v))
            c = min((w - d) * sharp + _HALF, _ONE)
            if c > boxes[0][at + lane]:
                boxes[0][at + lane], boxes[1][at + lane] = c, before + s
                boxes[2][at + lane] = min(max(t * per_r, -_ONE), _ONE)
                first, last = min(first, lane), lane
        return first, last

    def generator(self) -> Any:
        from numba.core import types as numba_types

        types: Any = numba_types

        def cover(
            _typing: Any, boxes: Any, at: Any, finished: Any, pixel: Any, x: Any, count: Any, segment: Any, ends: Any
        ) -> Any:
            def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
                given = Arguments(context, builder, signature, args)
                return context.make_tuple(builder, signature.return_type, self._instructions(Vectors(builder), given))

            result = types.UniTuple(types.intp, 2)
            return result(boxes, at, finished, pixel, x, count, segment, ends), generate

        return cover

    def _instructions(self, on: Vectors, given: Arguments) -> list[Any]:
        build = on.build
        coverage, lengthwise, crosswise = given.datas(0)
        at, pixel, x, count = (given.number(place) for place in (1, 3, 4, 5))
        segment = [on.all(value) for value in given.parts(6)]
        x0, ax, ay, s_row, t_row, length, before, part, r, per_r, taper_start, taper_end, sharp = segment
        fx = build.fsub(build.sitofp(build.add(on.short(x), on.lanes), on.floats), x0)
        s, t = build.fadd(build.fmul(fx, ax), s_row), build.fsub(t_row, build.fmul(fx, ay))
        p = on.least(on.most(s, on.zero), length)
        beyond = build.fsub(s, p)
        d = on.root(build.fadd(build.fmul(beyond, beyond), build.fmul(t, t)))
        w = r
        if self._tapers:
            u = build.fmul(build.fadd(before, p), part)
            tips = _from_tip(on, u), _from_tip(on, build.fsub(on.one, u))
            shares = [build.fmul(build.fmul(by, k), k) for by, k in zip((taper_start, taper_end), tips, strict=True)]
            w = build.fmul(r, build.fsub(on.one, build.fadd(*shares)))
        c = on.least(build.fadd(build.fmul(build.fsub(w, d), sharp), on.constant(0.5)), on.one)
        across = on.least(on.most(build.fmul(t, per_r), on.constant(-1.0)), on.one)

        old, old_s, old_t = (on.loaded(box, at) for box in (coverage, lengthwise, crosswise))
        done = on.loaded(given.data(2), pixel)
        still_open = build.icmp_unsigned("==", done, on.ir.Constant(done.type, [0] * LANES))
        within = build.icmp_signed("<", on.lanes, on.short(count))
        not_of_next = build.or_(build.not_(build.fcmp_ordered(">", s, length)), on.all(given.scalar(7)))
        usable = build.and_(not_of_next, build.and_(still_open, within))
        new = build.and_(build.fcmp_ordered(">", c, old), usable)
        on.store(on.most(build.select(usable, c, on.zero), old), coverage, at)
        on.store(build.select(new, build.fadd(before, s), old_s), lengthwise, at)
        on.store(build.select(new, across, old_t), crosswise, at)
        return _ends(on, new)


def _from_tip(on: Vectors, share: Any) -> Any:
    """1 at an end of the stroke (share 0), falling to 0 at the end of the tip."""
    return on.most(on.build.fsub(on.one, on.build.fmul(share, on.constant(float(PER_TIP)))), on.zero)


def _ends(on: Vectors, flags: Any) -> list[Any]:
    """Lanes of the first and of the last flag that is set; 8 and -1 if there is none."""
    ir, build = on.ir, on.build
    number, flag = ir.IntType(64), ir.IntType(1)
    kind = ir.FunctionType(number, [number, flag])
    below, above = (build.module.declare_intrinsic(f"llvm.{name}", [number], kind) for name in ("cttz", "ctlz"))
    bits = build.zext(build.bitcast(flags, ir.IntType(LANES)), number)
    first = build.call(below, [build.or_(bits, ir.Constant(number, 1 << LANES)), flag(0)])
    return [first, build.sub(number(63), build.call(above, [bits, flag(0)]))]


class Shade(Intrinsic):
    """`shade(boxes, at, image, pixel, tile, stroke, offsets, guided)`: turn coverage into paint, in place.

    Args of the call:
        at: index of the first pixel in `boxes`.
        image: uint8 (3 n,), red, green, blue of the picture that confines the stroke.
        pixel: index of the first pixel in it.
        tile: float32, texture of the bristles, flat, see `bristles.fine_tile`.
        stroke: opacity; squares of the colour distances up to which a pixel is covered in full and from which on it is
            not covered; 5/4 and 1/4 of the former; colour to which the pixels are compared, 3 numbers; grain; contrast
            of bristles, gray levels; how dry the brush becomes; 1 / length, 1/px; texels a px along the stroke and a
            radius across it.
        offsets: of the stroke in the tile, sub-rows and columns.
        guided: whether the picture confines the stroke; otherwise it is not read.
    """

    def __call__(
        self, boxes: Boxes, at: int, image: NDArray[np.uint8], pixel: int, tile: NDArray[np.float32], stroke: Floats,
        offsets: tuple[int, int], guided: bool,
    ) -> None:  # fmt: skip
        strength, inner2, outer2, far, span, red, green, blue, g, streaks, dry, part, pull, spread = stroke
        for place in range(at, at + LANES):
            lane = place - at
            a, along, t = boxes[0][place] * strength, boxes[1][place], boxes[2][place]
            if boxes[0][place] <= _ZERO:
                boxes[0][place] = _ZERO
                continue
            if guided:
                er, eg, eb = image[3 * (pixel + lane) : 3 * (pixel + lane) + 3].astype(np.float32) - (red, green, blue)
                e2 = er * er + eg * eg + eb * eb
                if e2 > inner2:
                    a *= (far - np.sqrt(e2)) / span
                if e2 >= outer2:
                    a = _ZERO
            light, ridge = _ZERO, _ONE - t * t * t * t
            if g > _ZERO:
                row = int(np.float32(8192) + t * spread * np.float32(SUBROWS)) + offsets[0]
                column = int(np.float32(8192) + along * pull) + offsets[1]
                trace = tile[256 * (row & 255) + (column & 255)]
                light = g * streaks * (trace - _HALF)
                ridge *= _ONE - g * (_ONE - trace)
                late = (along * part - _HALF) * np.float32(2)
                if late > _ZERO:
                    a *= _ONE - g * dry * late * (_ONE if trace < _HALF * late else _ZERO)
            boxes[0][place], boxes[1][place], boxes[2][place] = a, light, ridge

    def generator(self) -> Any:
        from numba.core import types as numba_types

        types: Any = numba_types

        def shade(
            _typing: Any, boxes: Any, at: Any, image: Any, pixel: Any, tile: Any, stroke: Any, offsets: Any, guided: Any
        ) -> Any:  # fmt: skip
            def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
                self._instruct(Vectors(builder), Arguments(context, builder, signature, args))
                return context.get_dummy_value()

            return types.void(boxes, at, image, pixel, tile, stroke, offsets, guided), generate

        return shade

    def _instruct(self, on: Vectors, given: Arguments) -> None:
        build = on.build
        boxes, at = given.datas(0), given.number(1)
        strength, inner2, outer2, far, span, *target, g, streaks, dry, part, pull, spread = map(on.all, given.parts(5))
        old = [on.loaded(box, at) for box in boxes]
        coverage, along, t = old
        covered = build.fcmp_ordered(">", coverage, on.zero)
        a = build.fmul(coverage, strength)

        def confined() -> Any:
            start = build.mul(given.number(3), on.ir.IntType(64)(3))
            bytes_ = on.loaded(given.data(2), start, 3 * LANES)
            squares = []
            for channel, wanted in enumerate(target):
                part_of = on.chosen(bytes_, bytes_, range(channel, 3 * LANES, 3))
                off = build.fsub(build.uitofp(part_of, on.floats), wanted)
                squares.append(build.fmul(off, off))
            e2 = build.fadd(build.fadd(squares[0], squares[1]), squares[2])
            less = build.fmul(a, build.fdiv(build.fsub(far, on.root(e2)), span))
            kept = build.select(build.fcmp_ordered(">", e2, inner2), less, a)
            return build.select(build.fcmp_ordered(">=", e2, outer2), on.zero, kept)

        a = on.where(given.scalar(7), confined, a)
        ridge = build.fsub(on.one, build.fmul(build.fmul(build.fmul(t, t), t), t))

        def haired() -> Any:
            across, lengthwise = (on.short(number) for number in self._offsets(on, given))
            row = build.fadd(on.constant(8192.0), build.fmul(build.fmul(t, spread), on.constant(float(SUBROWS))))
            column = build.fadd(on.constant(8192.0), build.fmul(along, pull))
            low = on.ir.Constant(on.numbers, [255] * LANES)
            row, column = (
                build.and_(build.add(build.fptosi(place, on.numbers), offset), low)
                for place, offset in ((row, across), (column, lengthwise))
            )
            index = build.add(build.shl(row, on.ir.Constant(on.numbers, [8] * LANES)), column)
            trace = on.gathered(given.data(4), index)
            light = build.fmul(build.fmul(g, streaks), build.fsub(trace, on.constant(0.5)))
            height = build.fmul(ridge, build.fsub(on.one, build.fmul(g, build.fsub(on.one, trace))))
            late = build.fmul(build.fsub(build.fmul(along, part), on.constant(0.5)), on.constant(2.0))
            gone = build.select(build.fcmp_ordered("<", trace, build.fmul(on.constant(0.5), late)), on.one, on.zero)
            drier = build.fsub(on.one, build.fmul(build.fmul(build.fmul(g, dry), late), gone))
            left = build.select(build.fcmp_ordered(">", late, on.zero), build.fmul(a, drier), a)
            both = on.chosen(left, light, range(2 * LANES))
            return on.chosen(both, on.chosen(height, height, range(2 * LANES)), range(3 * LANES))

        plain = on.chosen(a, on.zero, range(2 * LANES))
        plain = on.chosen(plain, on.chosen(ridge, ridge, range(2 * LANES)), range(3 * LANES))
        grainy = build.fcmp_ordered(">", given.parts(5)[8], on.ir.FloatType()(0.0))
        made = on.where(grainy, haired, plain)
        for k, box in enumerate(boxes):
            value = on.chosen(made, made, range(k * LANES, (k + 1) * LANES))
            on.store(build.select(covered, value, on.zero if k == 0 else old[k]), box, at)

    def _offsets(self, on: Vectors, given: Arguments) -> list[Any]:
        wide = on.ir.IntType(64)
        return [part if part.type == wide else on.build.sext(part, wide) for part in given.parts(6)]


class Lay(Intrinsic):
    """`lay(paint, index, opacity, light, ridge, colour)`: lay paint behind what is in a pixel.

    Args of the call:
        paint: float32 (5 n,), see `streamlines_forward.FrontToBack`.
        index: of the pixel's first number.
        opacity, light, ridge: from `Shade`.
        colour: red, green, blue; height of the paint, px.

    Returns:
        The transmittance of the pixel.
    """

    def __call__(
        self, paint: NDArray[np.float32], index: int, opacity: np.float32, light: np.float32, ridge: np.float32,
        colour: Floats,
    ) -> np.float32:  # fmt: skip
        a = opacity * paint[index + 4]
        for k in range(3):
            paint[index + k] += a * (colour[k] + light)
        paint[index + 3] += a * colour[3] * ridge
        paint[index + 4] -= a
        left: np.float32 = paint[index + 4]
        return left

    def generator(self) -> Any:
        from numba.core import types as numba_types

        types: Any = numba_types

        def lay(_typing: Any, paint: Any, index: Any, opacity: Any, light: Any, ridge: Any, colour: Any) -> Any:
            def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
                return self._instructions(Vectors(builder), Arguments(context, builder, signature, args))

            return types.float32(paint, index, opacity, light, ridge, colour), generate

        return lay

    def _instructions(self, on: Vectors, given: Arguments) -> Any:
        build, paint, index = on.build, given.data(0), given.number(1)
        opacity, light, ridge = (given.scalar(place) for place in (2, 3, 4))
        last = build.gep(paint, [on.plus(index, 4)])
        left = build.load(last)
        a = build.fmul(opacity, left)
        one, zero = on.ir.FloatType()(1.0), on.ir.FloatType()(0.0)
        colour = build.fadd(self._four(on, given.parts(5)), self._four(on, [light, light, light, zero]))
        laid = build.fmul(build.fmul(self._four(on, [a] * 4), colour), self._four(on, [one, one, one, ridge]))
        on.store(build.fadd(on.loaded(paint, index, 4), laid), paint, index)
        left = build.fsub(left, a)
        build.store(left, last)
        return left

    def _four(self, on: Vectors, values: list[Any]) -> Any:
        found = on.ir.Constant(on.ir.VectorType(on.ir.FloatType(), 4), on.ir.Undefined)
        for place, value in enumerate(values):
            found = on.build.insert_element(found, value, on.ir.Constant(on.ir.IntType(32), place))
        return found


cover_even, cover_tapered = Cover(tapers=False), Cover(tapers=True)
shade, lay = Shade(), Lay()
