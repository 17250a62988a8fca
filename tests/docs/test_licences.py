"""docs/operations.md names every installed package whose licence asks more of who redistributes it than its text."""

from __future__ import annotations

import re
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

import av
from packaging.requirements import Requirement

PAGE = (Path(__file__).parents[2] / "docs" / "operations.md").read_text()
EXTRAS = ("cpu", "webrtc", "window", "cluster", "cuts", "oidc", "s3", "postgresql")
OBLIGES = re.compile(r"GPL|MPL|Mozilla|Proprietary")
EITHER = re.compile(r"\bOR\b")


def _installed(name: str, extras: tuple[str, ...], known: set[str]) -> Iterator[str]:
    """Names of the distributions that an installation of `name` has."""
    try:
        found = distribution(name)
    except PackageNotFoundError:
        return
    key = f"{name.lower()}{extras}"
    if key in known:
        return
    known.add(key)
    yield name
    for line in found.requires or []:
        needed = Requirement(line)
        if needed.marker is None or any(needed.marker.evaluate({"extra": extra}) for extra in extras or ("",)):
            yield from _installed(needed.name, tuple(sorted(needed.extras)), known)


def _licence(name: str) -> str:
    facts = distribution(name).metadata
    classifiers = [text for text in facts.get_all("Classifier", []) if "License" in text]
    return " ".join([facts["License-Expression"] or "", (facts["License"] or "")[:200], *classifiers])


def test_packages_with_obligations_are_named() -> None:
    found = {name for name in _installed("impasto", EXTRAS, set()) if OBLIGES.search(_licence(name))}
    found = {name for name in found if not EITHER.search(_licence(name))}
    assert found, "psycopg at least"
    assert [name for name in sorted(found) if f"`{name.lower()}`" not in PAGE] == []


def test_pyav_still_contains_the_encoders_under_the_gpl() -> None:
    assert {av.Codec(name, "w").name for name in ("libx264", "libx265")} == {"libx264", "libx265"}
    assert "libx264 and libx265: GPL" in PAGE
