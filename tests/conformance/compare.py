"""The verdict on one file: equal, refused by both, refused for a stated limit, or different."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from tests.conformance.facts import Facts

TIME_S, COLOUR, ONSET_S = 0.03, 6.0, 0.03
LIMITS = (
    "too small", "too many pixels", "too many bytes", "too long", "no video stream", "JSON", "of an unknown kind",
    "not an image", "codec is unknown",
)  # fmt: skip
"""Parts of refusals that state a limit of Impasto, or a kind of file that it does not take."""


@dataclass(frozen=True)
class Verdict:
    """Attributes:
    kind: "equal", "refused by both", "limit", "explained" or "different".
    why: the differences, or the refusal.
    """

    file: str
    kind: str
    why: str = ""


def verdict(path: Path, root: Path, reference: Facts, ours: Facts) -> Verdict:
    """Compare what the two readers found in a file."""
    name = str(path.relative_to(root))
    if reference.refused and ours.refused:
        return Verdict(name, "refused by both", ours.refused)
    if ours.refused:
        kind = "limit" if any(text in ours.refused for text in LIMITS) else "different"
        return Verdict(name, kind, f"refused: {ours.refused}")
    if reference.refused and ours.damaged:
        return Verdict(name, "explained", f"refused: {reference.refused}; read up to the damage, which is named.")
    if reference.refused:
        return Verdict(name, "different", f"only we read it: {ours.pictures} pictures ({reference.refused})")
    found = differences(reference, ours)
    if len(found) == 1 and found[0].startswith("size") and any("crops" in note for note in ours.notes):
        return Verdict(name, "explained", f"{found[0]}; {ours.notes[-1]} FFmpeg's command does so too, PyAV does not.")
    return Verdict(name, "different" if found else "equal", "; ".join(found + ours.notes if found else []))


def differences(reference: Facts, ours: Facts) -> list[str]:
    """What differs, the reference's value first."""
    found = []
    least = ours.pictures - ours.repeated if reference.damaged else ours.pictures
    if not least <= reference.pictures <= ours.pictures:
        found.append(f"pictures {reference.pictures} / {ours.pictures}")
    elif not reference.damaged and (worst := _worst_time(reference, ours)):
        found.append(worst)
    if reference.size != ours.size:
        found.append(f"size {reference.size} / {ours.size}")
    pairs = zip(reference.colours, ours.colours, strict=False)
    if any(max(abs(a - b) for a, b in zip(one, other, strict=True)) > COLOUR for one, other in pairs):
        found.append(f"colour {_rounded(reference)} / {_rounded(ours)}")
    if ours.damaged and not reference.damaged:
        found.append("called damaged")
    if (reference.onset_s is None) != (ours.onset_s is None) or (
        reference.onset_s is not None and ours.onset_s is not None and abs(reference.onset_s - ours.onset_s) > ONSET_S
    ):
        found.append(f"sound {reference.onset_s} / {ours.onset_s}")
    return found


def _worst_time(reference: Facts, ours: Facts) -> str:
    pairs = list(zip(reference.times_s, ours.times_s, strict=False))
    worst = max(range(len(pairs)), key=lambda at: abs(pairs[at][0] - pairs[at][1]), default=0)
    if not pairs or abs(pairs[worst][0] - pairs[worst][1]) <= TIME_S:
        return ""
    return f"time of picture {worst}: {pairs[worst][0]:.3f} / {pairs[worst][1]:.3f} s"


def _rounded(facts: Facts) -> list[list[int]]:
    return [[round(value) for value in colour] for colour in facts.colours]
