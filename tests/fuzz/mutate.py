"""Mutation of well-formed files: bits, numbers, pieces and ends are changed at random."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np

from pipeline.methods.base import seeded

Random = np.random.Generator
_NUMBERS = (0, 1, 0x7F, 0x80, 0xFF, 0x7FFF, 0x8000, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF)
_HEADER_BYTES = 256
"""Half of all changes are within the first bytes, which contain sizes, counts and offsets."""


def mutated(data: bytes, other: bytes, seed: int, number: int) -> bytes:
    """Case `number` of a seed: `data` after one to eight changes; pieces are copied from `other`."""
    random = seeded(seed, number)
    changed = bytearray(data)
    for _ in range(int(random.integers(1, 9))):
        if changed:
            _CHANGES[random.integers(len(_CHANGES))](changed, other, random)
    return bytes(changed)


def _place(data: bytearray, random: Random) -> int:
    end = min(len(data), _HEADER_BYTES) if random.random() < 0.5 else len(data)
    return int(random.integers(end))


def _span(size: int, random: Random) -> tuple[int, int]:
    """A piece of up to 2^12 bytes, short ones more often."""
    start = int(random.integers(size))
    return start, min(size, start + int(2 ** random.uniform(0, 12)))


def _flip_bit(data: bytearray, other: bytes, random: Random) -> None:
    data[_place(data, random)] ^= 1 << int(random.integers(8))


def _set_number(data: bytearray, other: bytes, random: Random) -> None:
    """Set an integer of one, two, four or eight bytes to a limit, or to a value near the present one."""
    width = 2 ** int(random.integers(4))
    order: Literal["little", "big"] = "little" if random.integers(2) else "big"
    start = _place(data, random)
    there = int.from_bytes(data[start : start + width], order)
    chosen = _NUMBERS[random.integers(len(_NUMBERS))] if random.random() < 0.7 else there + int(random.integers(-4, 5))
    data[start : start + width] = (chosen % (1 << (8 * width))).to_bytes(width, order)


def _overwrite(data: bytearray, other: bytes, random: Random) -> None:
    start, stop = _span(len(data), random)
    data[start:stop] = random.bytes(stop - start)


def _delete(data: bytearray, other: bytes, random: Random) -> None:
    start, stop = _span(len(data), random)
    del data[start:stop]


def _repeat(data: bytearray, other: bytes, random: Random) -> None:
    start, stop = _span(len(data), random)
    data[start:start] = data[start:stop] * int(random.integers(1, 4))


def _cut_off(data: bytearray, other: bytes, random: Random) -> None:
    del data[_place(data, random) + 1 :]


def _graft(data: bytearray, other: bytes, random: Random) -> None:
    start, stop = _span(len(other), random)
    at = _place(data, random)
    data[at : at + stop - start] = other[start:stop]


_CHANGES: tuple[Callable[[bytearray, bytes, Random], None], ...] = (
    _flip_bit, _flip_bit, _set_number, _set_number, _set_number, _overwrite, _delete, _repeat, _cut_off, _graft,
)  # fmt: skip
