"""The recorded values: values.json beside this file."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests.regression.pinned import Values, machine

FILE = Path(__file__).with_name("values.json")


@dataclass(frozen=True)
class Recorded:
    """What values.json holds.

    Attributes:
        machine: the machine the values apply to; see `pinned.machine`.
        cases: case -> name -> SHA-256.
    """

    machine: Mapping[str, Any]
    cases: Values


def read() -> Recorded:
    """The recorded values; none where the file is missing."""
    if not FILE.exists():
        return Recorded({}, {})
    return Recorded(**json.loads(FILE.read_text()))


def write(cases: Values) -> None:
    """Record values for this machine."""
    ordered = {name: cases[name] for name in sorted(cases)}
    FILE.write_text(json.dumps({"machine": machine(), "cases": ordered}, indent=1) + "\n")


def differences(recorded: Mapping[str, str], found: Mapping[str, str]) -> list[str]:
    """Names whose values differ, or are on one side only."""
    return sorted(name for name in recorded.keys() | found.keys() if recorded.get(name) != found.get(name))
