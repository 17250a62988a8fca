"""`make laws MINUTES=...`: cases for so long; the seeds that break a law are kept in `failing.json` and tried first."""

from __future__ import annotations

import argparse
import itertools
import json
import time
import traceback
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path

from tests.laws.cases import generated
from tests.laws.laws import LAWS, Verdict
from tests.laws.wrong import everything_wrong_is_said

KEPT = Path(__file__).with_name("failing.json")
SAID_A_CASE = 20
"""Requests that are checked for each painted case: a check takes a hundredth of its time."""


def checks() -> Mapping[str, Callable[[int], Verdict]]:
    """Law -> check of a seed."""
    painted = {name: (lambda seed, law=law: law(generated(seed))) for name, law in LAWS.items()}
    return {**painted, everything_wrong_is_said.__name__: everything_wrong_is_said}


def verdict(name: str, seed: int) -> Verdict:
    """What is wrong with a seed; an unexpected error is a fault, too."""
    try:
        return checks()[name](seed)
    except Exception as error:
        places = "; ".join(
            f"{Path(at.filename).name}:{at.lineno}" for at in traceback.extract_tb(error.__traceback__)[-4:]
        )
        return f"{type(error).__name__}: {str(error)[:200]} ({places})"


def kept() -> list[tuple[str, int]]:
    """(law, seed) of the kept failures."""
    found = json.loads(KEPT.read_text()) if KEPT.exists() else []
    return [(str(name), int(seed)) for name, seed in found]


def main() -> int:
    """Run; returns 1 if a case breaks a law."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=5)
    parser.add_argument("--seed", type=int, default=0, help="the first")
    given = parser.parse_args()
    end, counts, failing = time.monotonic() + 60 * given.minutes, Counter[str](), list[tuple[str, int]]()
    said = ((everything_wrong_is_said.__name__, seed) for seed in itertools.count(given.seed))
    painted = ((name, seed) for seed in itertools.count(given.seed) for name in LAWS)
    mixed = (one for case in painted for one in (case, *itertools.islice(said, SAID_A_CASE)))
    for name, seed in itertools.chain(kept(), mixed):
        if time.monotonic() > end:
            break
        counts[name] += 1
        if (wrong := verdict(name, seed)) is not None:
            failing.append((name, seed))
            print(f"{name} {seed}: {wrong}\n    {generated(seed)}", flush=True)
    if failing:
        KEPT.write_text(json.dumps(sorted(set(failing))) + "\n")
    print(f"{counts.total()} cases: {dict(counts)}; {len(failing)} break a law")
    return bool(failing)


if __name__ == "__main__":
    raise SystemExit(main())
