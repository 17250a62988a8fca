"""Frame numbers in the file names of image sequences, painted keys and masks.

A name has one or more runs of digits. The frame number is the run that counts: the one that differs between names that
are otherwise equal. Copies ("0006 (1)"), versions ("v02"), seeds ("00006-7") and layer names ("_0006_Layer 2") have
other runs; where two runs could be the number, the name is refused, never guessed.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import PurePosixPath
from typing import NamedTuple, NoReturn

from pipeline.errors import NotASequence

_RUN = re.compile(r"(?<![A-Za-z0-9])(?<![-+])[-+][0-9]+|[0-9]+")
"""A run of digits; a sign before it counts if no letter, digit or sign is before the sign: "f_-003", not "shot-003"."""
_COPY = re.compile(r"(?<=[^ ])(?: \([0-9]+\)| ?- ?Copy(?: \([0-9]+\))?| copy(?: [0-9]+)?)$", re.IGNORECASE)
_VERSION = re.compile(r"(?:^|[^A-Za-z])[vV]$")
_PADDED_DIGITS = 3
_PLACEHOLDER = re.compile(r"%0?([0-9]*)d|#+|\[(-?[0-9]+)-(-?[0-9]+)\]")
_NAMED = 5
"""Most names that a message lists."""


class Run(NamedTuple):
    text: str
    version: bool

    @property
    def number(self) -> int:
        return int(self.text)

    @property
    def padded(self) -> bool:
        digits = self.text.lstrip("+-")
        return digits.startswith("0") and len(digits) >= _PADDED_DIGITS


@dataclass(frozen=True)
class Name:
    """A file name, split into its shape (folder, text with "#" for each run of digits, extension) and the runs."""

    path: str
    shape: str
    runs: tuple[Run, ...]
    copy: bool

    @classmethod
    def of(cls, path: str) -> Name:
        pure = PurePosixPath(path)
        stem = _COPY.sub("", pure.stem)
        runs = tuple(Run(m[0], bool(_VERSION.search(stem[: m.start()]))) for m in _RUN.finditer(stem))
        return cls(path, f"{pure.parent}/{_RUN.sub('#', stem)}{pure.suffix.lower()}", runs, stem != pure.stem)


def frame_numbers(paths: Iterable[str], field: str = "file") -> dict[str, int | None]:
    """The frame number of each path; None: its name has no digits.

    Raises: NotASequence: a name has several runs of digits that could be its number, or two have one number.
    """
    groups: dict[str, list[Name]] = {}
    for name in map(Name.of, paths):
        groups.setdefault(name.shape, []).append(name)
    found = {path: number for group in groups.values() for path, number in _numbers(group, field).items()}
    _check_unique(found, field)
    return found


def _numbers(group: Sequence[Name], field: str) -> dict[str, int | None]:
    count = len(group[0].runs)
    if count == 0:
        return {name.path: None for name in group}
    own = [at for at in range(count) if not all(name.runs[at].version for name in group)]
    place = _only([at for at in own if _differs(group, at)])
    if place is None:
        place = _likeliest(group, own)
    if place is None:
        _refuse("It is unclear which number in a name is the frame's.", field, group[0].path,
                "Leave one number in the names, or write it with leading zeros: key_0006.png.")  # fmt: skip
    return {name.path: name.runs[place].number for name in group}


def _differs(group: Sequence[Name], at: int) -> bool:
    return len({name.runs[at].number for name in group}) > 1


def _likeliest(group: Sequence[Name], own: Sequence[int]) -> int | None:
    """The run of digits that numbers the frames, or None. Versions do not count, unless there is nothing else. Among
    several runs, the only one with leading zeros and one width in all names is chosen."""
    if len(own) <= 1:
        return own[0] if own else len(group[0].runs) - 1
    differing = [at for at in own if _differs(group, at)] or own
    return _only([at for at in differing if _is_padded(group, at)])


def _is_padded(group: Sequence[Name], at: int) -> bool:
    widths = {len(name.runs[at].text.lstrip("+-")) for name in group}
    return len(widths) == 1 and all(name.runs[at].padded for name in group)


def _only(places: Collection[int]) -> int | None:
    return next(iter(places)) if len(places) == 1 else None


def _check_unique(found: Mapping[str, int | None], field: str) -> None:
    first: dict[int, str] = {}
    for path, number in found.items():
        if number is not None and first.setdefault(number, path) != path:
            _refuse_two(number, first[number], path, field)


def _refuse_two(number: int, one: str, other: str, field: str) -> NoReturn:
    _refuse(f"Two images have the number {number}.", field, f"{one} and {other}", "Remove one of them.")


def sequence_numbers(paths: Iterable[str], pattern: str = "", field: str = "file") -> list[tuple[int | None, str]]:
    """The images of one sequence: (number, path), ascending. One image may lack a number.

    Args:
        pattern: "" or a file name with "%04d", "####" or "[1-20]" for the number: other images are left out.

    Raises: NotASequence: there are several sequences, images without numbers, or unclear numbers.
    """
    listed = sorted(paths)
    if pattern:
        return _matching(listed, pattern, field)
    shapes: dict[str, list[str]] = {}
    for path in listed:
        shapes.setdefault(Name.of(path).shape, []).append(path)
    if len(shapes) > 1:
        _ask(shapes, field)
    if len(listed) == 1:
        return [(_alone(listed[0]), listed[0])]
    found = frame_numbers(listed, field)
    if any(number is None for number in found.values()):
        _refuse("The images have no numbers.", field, listed[0], "Number them in their names: frame_0001.png.")
    return sorted(((number, path) for path, number in found.items()), key=lambda pair: pair[0] or 0)


def _alone(path: str) -> int | None:
    """The number of the only image: None if it is unclear, which makes no difference."""
    try:
        return frame_numbers([path])[path]
    except NotASequence:
        return None


def _ask(shapes: Mapping[str, Sequence[str]], field: str) -> NoReturn:
    copies = [path for paths in shapes.values() for path in paths if Name.of(path).copy]
    named = [f"{_pattern(paths)} ({len(paths)} images)" for paths in list(shapes.values())[:_NAMED]]
    more = f" and {len(shapes) - _NAMED} more" if len(shapes) > _NAMED else ""
    _refuse(
        f"There are {len(shapes)} sequences of images, where one is expected: {', '.join(named)}{more}.", field,
        copies[0] if copies else min(shapes.values(), key=len)[0],
        "Name one with a pattern, such as shot.####.png, or remove the other images.",
    )  # fmt: skip


def _pattern(paths: Sequence[str]) -> str:
    """A pattern that fits these paths, which have one shape."""
    first = PurePosixPath(paths[0])
    if len(paths) == 1:
        return str(first)
    names = [Name.of(path) for path in paths]
    places = [at for at in range(len(names[0].runs)) if _differs(names, at)]
    pieces, runs = _RUN.split(_COPY.sub("", first.stem)), names[0].runs
    filled = [p + ("####" if at in places else runs[at].text if at < len(runs) else "") for at, p in enumerate(pieces)]
    return str(first.with_name("".join(filled) + first.suffix))


def _matching(paths: Sequence[str], pattern: str, field: str) -> list[tuple[int | None, str]]:
    found = sorted((number, path) for path in paths if (number := number_by(pattern, path)) is not None)
    if not found:
        _refuse(
            "No image fits the pattern.", "pattern", pattern, f"There is, for example, {paths[0]}." if paths else ""
        )
    for one, other in pairwise(found):
        if one[0] == other[0]:
            _refuse_two(one[0], one[1], other[1], field)
    return list(found)


def is_pattern(text: str) -> bool:
    """Whether a file name has one placeholder for a frame number."""
    return len(_PLACEHOLDER.findall(PurePosixPath(text).name)) == 1


def number_by(pattern: str, path: str) -> int | None:
    """The number of a path by a pattern; None: it does not fit, or its number is outside the pattern's range."""
    name = PurePosixPath(pattern).name
    place = _PLACEHOLDER.search(name)
    if place is None:
        return None
    text = PurePosixPath(path).name
    before, after = name[: place.start()], name[place.end() :]
    found = re.fullmatch(re.escape(before) + r"([-+]?[0-9]+)" + re.escape(after), text, re.IGNORECASE)
    if found is None or len(found[1].lstrip("+-")) < _least_digits(place):
        return None
    number = int(found[1])
    bounds = range_of(pattern)
    return number if bounds is None or bounds[0] <= number <= bounds[1] else None


def name_by(pattern: str, number: int) -> str:
    """The name of the image of this number by a pattern with "####" or "%04d"; a sign needs one place more."""
    place = _PLACEHOLDER.search(pattern)
    if place is None:
        raise ValueError(f"no place for a number: {pattern}")
    digits = len(place[0]) if place[0].startswith("#") else int(place[1] or 1)
    return f"{pattern[: place.start()]}{number:0{digits + (number < 0)}d}{pattern[place.end() :]}"


def has_place(name: str) -> bool:
    """Whether a file name is a pattern, with a place for a number."""
    return _PLACEHOLDER.search(name) is not None


def _least_digits(place: re.Match[str]) -> int:
    if place[0].startswith("%"):
        return int(place[1] or 1) - 1  # a sign takes one of the places
    return len(place[0]) - 1 if place[0].startswith("#") else 1


def range_of(pattern: str) -> tuple[int, int] | None:
    """First and last number of a pattern with "[1-20]"; None: it has no range."""
    place = _PLACEHOLDER.search(PurePosixPath(pattern).name)
    return (int(place[2]), int(place[3])) if place is not None and place[2] is not None else None


# -- which frames


@dataclass(frozen=True)
class Numbered:
    """The frames of a sequence: their numbers, and for each the image that is shown, an index into the images."""

    numbers: tuple[int, ...]
    shown: tuple[int, ...]
    notes: tuple[str, ...]


def frames_of(
    numbers: Sequence[int], missing: str, bounds: tuple[int, int] | None = None, most: int = 1_000_000
) -> Numbered:
    """Frames of images with these ascending numbers.

    Numbers in equal steps (every second frame, at least three images) have no gap.

    Args:
        missing: "fail"; "hold": the image before a gap is shown again (before the first image: that one); "skip".
        bounds: first and last number that should be there; None: those that are.
        most: maximum number of frames.

    Raises: NotASequence: numbers are missing, and `missing` is "fail".
    """
    step = _step(numbers)
    first, last = bounds or (numbers[0], numbers[-1])
    lacking = lacking_runs(numbers, first, last, step)
    if lacking and missing == "fail":
        _refuse(f"{_named(lacking).capitalize()} missing from the sequence.", "missing", f"{first}-{last}",
                "Render them, or choose missing=hold (repeat the frame before) or missing=skip.")  # fmt: skip
    every = f"The numbers go in steps of {step}: no frame counts as missing."
    notes = [every] if step > 1 else []
    if lacking:
        instead = "the frame before is shown instead" if missing == "hold" else "the frames after follow at once"
        notes.append(f"{_named(lacking).capitalize()} missing: {instead}.")
    if any(number < 0 for number in numbers):
        notes.append(f"The first number is negative: {numbers[0]}.")
    if not lacking or missing == "skip":
        return Numbered(tuple(numbers), tuple(range(len(numbers))), tuple(notes))
    if (last - first) // step >= most:
        _refuse(
            "The gaps of the sequence are too long to repeat the frame before.",
            "missing",
            f"{first}-{last}",
            "Use missing=skip.",
        )
    filled, at = [], 0
    for number in range(first, last + 1, step):
        while at + 1 < len(numbers) and numbers[at + 1] <= number:
            at += 1
        filled.append((number, at))
    return Numbered(tuple(n for n, _ in filled), tuple(at for _, at in filled), tuple(notes))


def has_gaps(numbers: Sequence[int]) -> bool:
    """Whether numbers are missing between these ascending ones."""
    return bool(lacking_runs(numbers, numbers[0], numbers[-1], _step(numbers)))


def _step(numbers: Sequence[int]) -> int:
    steps = {later - one for one, later in pairwise(numbers)}
    return steps.pop() if len(steps) == 1 and len(numbers) >= 3 else 1


def lacking_runs(numbers: Sequence[int], first: int, last: int, step: int) -> list[tuple[int, int]]:
    """Runs (first, last) of the numbers that are missing between `first` and `last`."""
    found, following = [], first
    for number in [*numbers, last + step]:
        if number > following:
            found.append((following, number - step))
        following = max(following, number + step)
    return found


def _named(runs: Sequence[tuple[int, int]]) -> str:
    names = [f"{first}" if first == last else f"{first} to {last}" for first, last in runs[:_NAMED]]
    more = f" and {len(runs) - _NAMED} more runs" if len(runs) > _NAMED else ""
    one = len(runs) == 1 and runs[0][0] == runs[0][1]
    return f"{'frame' if one else 'frames'} {', '.join(names)}{more} {'is' if one else 'are'}"


# -- numbers of many frames in few words

Runs = tuple[tuple[int, int, int], ...]
"""(first, last, step) of numbers that ascend in equal steps."""


def runs_of_numbers(numbers: Sequence[int]) -> Runs:
    """The numbers as few runs."""
    found: list[list[int]] = []
    for number in numbers:
        if found and (found[-1][2] == number - found[-1][1] or found[-1][0] == found[-1][1]):
            found[-1][2] = number - found[-1][1]
            found[-1][1] = number
        else:
            found.append([number, number, 1])
    return tuple((first, last, step) for first, last, step in found)


def numbers_of_runs(runs: Iterable[Sequence[int]]) -> list[int]:
    return [number for first, last, step in runs for number in range(first, last + 1, step)]


def described(runs: Iterable[Sequence[int]]) -> str:
    """The numbers in words: "1001 to 1012"."""
    names = [
        f"{r[0]}" if r[0] == r[1] else f"{r[0]} to {r[1]}" + (f" in steps of {r[2]}" if r[2] > 1 else "") for r in runs
    ]
    return ", ".join(names[:_NAMED]) + (f" and {len(names) - _NAMED} more runs" if len(names) > _NAMED else "")


def _refuse(message: str, field: str, value: object, remedy: str) -> NoReturn:
    raise NotASequence(message, field=field, value=value, remedy=remedy)
