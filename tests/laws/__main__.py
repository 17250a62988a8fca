"""`make laws MINUTES=...`: cases for so long; the seeds that break a law are kept in `failing.json` and tried first."""

from __future__ import annotations

import argparse
import itertools
import json
import time
import traceback
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from tests.laws.cases import Case, generated
from tests.laws.laws import LAWS, Verdict
from tests.laws.ways import WAYS, Films
from tests.laws.wrong import everything_wrong_is_said

KEPT = Path(__file__).with_name("failing.json")
SAID = everything_wrong_is_said.__name__
SAID_A_CASE = 5
"""Requests that are checked for each film: a check takes a hundredth of the time of one."""


def verdict(name: str, seed: int, films: Films | None = None) -> Verdict:
    """What is wrong with a seed; an unexpected error is a fault, too. `films`: what other laws of the seed painted."""
    try:
        return everything_wrong_is_said(seed) if name == SAID else LAWS[name](generated(seed), films or Films())
    except Exception as error:
        places = "; ".join(
            f"{Path(at.filename).name}:{at.lineno}" for at in traceback.extract_tb(error.__traceback__)[-4:]
        )
        return f"{type(error).__name__}: {str(error)[:200]} ({places})"


def verdicts(seed: int) -> dict[str, Verdict]:
    """Law -> verdict, of the laws about films; the laws share what they paint."""
    films = Films()
    return {name: verdict(name, seed, films) for name in LAWS}


def kept() -> list[tuple[str, int]]:
    """(law, seed) of the kept failures."""
    found = json.loads(KEPT.read_text()) if KEPT.exists() else []
    return [(str(name), int(seed)) for name, seed in found]


def mixed(first: int) -> Iterator[tuple[str, int, Verdict]]:
    """(law, seed, verdict) without end: the kept failures, then all laws in turns."""
    yield from ((name, seed, verdict(name, seed)) for name, seed in kept())
    said = itertools.count(first)
    for seed in itertools.count(first):
        yield from ((name, seed, wrong) for name, wrong in verdicts(seed).items())
        yield from ((SAID, other, verdict(SAID, other)) for other in itertools.islice(said, SAID_A_CASE))


def covered(cases: list[Case]) -> str:
    """What the cases have contained, in words."""
    params = {(case.method, name) for case in cases for name in case.params}
    inputs = {(case.method, name) for case in cases for name in case.inputs}
    methods = {case.method for case in cases}
    return f"{len(methods)} methods, {len(params)} parameters, {len(inputs)} inputs, {len(WAYS)} ways besides the plan"


def main() -> int:
    """Run; returns 1 if a case breaks a law."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=5)
    parser.add_argument("--seed", type=int, default=0, help="the first")
    given = parser.parse_args()
    end, counts, failing = time.monotonic() + 60 * given.minutes, Counter[str](), list[tuple[str, int]]()
    last = given.seed
    for name, seed, wrong in mixed(given.seed):
        counts[name] += 1
        last = seed if name in LAWS else last
        if wrong is not None:
            failing.append((name, seed))
            print(f"{name} {seed}: {wrong}\n    {generated(seed)}", flush=True)
        if time.monotonic() > end:
            break
    if failing:
        KEPT.write_text(json.dumps(sorted(set(failing))) + "\n")
    print(f"{counts.total()} cases: {dict(counts)}; {len(failing)} break a law")
    print(covered([generated(seed) for seed in range(given.seed, last + 1)]))
    return bool(failing)


if __name__ == "__main__":
    raise SystemExit(main())
