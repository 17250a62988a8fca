"""SMPTE timecode: labels of frames, "01:00:59:12", and "01:00:59;28" with two labels a minute dropped (ST 12-1)."""

from __future__ import annotations

import re
from fractions import Fraction

from pipeline.errors import BadParameter

_LABEL = re.compile(r"(\d{1,2}):(\d{2}):(\d{2})([:;.])(\d{2,3})")
_USUAL = (24, 25, 30, 48, 50, 60)
_DROPPED = {30: 2, 60: 4}
"""Labels per second -> labels that drop-frame timecode leaves out in each minute but the tenth."""


def usual_rate(found: Fraction | float | None) -> Fraction | None:
    """The rate in frames per second that timecode counts and that is `found`; None: there is none."""
    usual = (Fraction(nominal * 1000, divisor) for nominal in _USUAL for divisor in (1000, 1001))
    return next((rate for rate in usual if found and abs(rate - Fraction(found)) < rate / 2000), None)


def is_timecode(text: str) -> bool:
    return _LABEL.fullmatch(text) is not None


def frame_of(label: str, rate: Fraction, field: str = "timecode") -> int:
    """The number of the frame with this label, counted from that of 00:00:00:00. Raises BadParameter."""
    found, nominal = _LABEL.fullmatch(label), round(rate)
    if not found or int(found[5]) >= nominal or int(found[2]) > 59 or int(found[3]) > 59:
        raise BadParameter(
            f"It is no timecode at {nominal} frames per second.", field=field, value=label,
            remedy="Write HH:MM:SS:FF, or HH:MM:SS;FF for drop-frame timecode.",
        )  # fmt: skip
    hours, minutes, seconds, frames = (int(found[group]) for group in (1, 2, 3, 5))
    total_minutes = 60 * hours + minutes
    count = (60 * total_minutes + seconds) * nominal + frames
    if found[4] == ":":
        return count
    return count - _DROPPED.get(nominal, 0) * (total_minutes - total_minutes // 10)


def label_of(frame: int, rate: Fraction, drop: bool) -> str:
    """The label of a frame: the inverse of `frame_of`. After 24 hours it begins again."""
    nominal = round(rate)
    dropped = _DROPPED.get(nominal, 0) if drop else 0
    per_minute, per_ten = 60 * nominal - dropped, 600 * nominal - 9 * dropped
    frame %= 144 * per_ten
    tens, rest = divmod(frame, per_ten)
    if dropped:
        frame += dropped * (9 * tens + max(0, (rest - dropped) // per_minute))
    seconds, frames = divmod(frame, nominal)
    return f"{seconds // 3600:02d}:{seconds // 60 % 60:02d}:{seconds % 60:02d}{';' if dropped else ':'}{frames:02d}"


def shifted(label: str, frames: int, rate: Fraction) -> str:
    """The label `frames` later."""
    return label_of(frame_of(label, rate) + frames, rate, ";" in label)
