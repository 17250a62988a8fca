"""`python -m tests.abuse --seconds 10`: attacks of one key on a service, and a table of what the others got.

`--tree FOLDER` abuses the program of another checkout with an environment of its own; `--only TEXT` runs the attacks
whose name contains the text. Exit status 1 if a limit is exceeded.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from tests.abuse.attacks import ATTACKS, attack_of
from tests.abuse.measure import Found, measured, p99, settled
from tests.abuse.target import target

ROOT = Path(__file__).resolve().parents[2]


HEAD = "| attack | answers | /healthz p99, s | another's jobs p99, s | RSS, MiB | threads | |"


def main() -> int:
    given = _parser().parse_args()
    print(f"{HEAD}\n|---|---|---|---|---|---|---|", flush=True)
    found = run([name for name in ATTACKS if given.only in name], given.seconds, given.tree)
    return min(1, sum(_print(one) for one in found))


def run(names: list[str], seconds: float, tree: Path = ROOT) -> Iterator[Found]:
    """Run attacks one after another on one service; on a new one where an attack has left it without an answer."""
    while names:
        with tempfile.TemporaryDirectory(prefix="impasto-abuse-") as folder, target(Path(folder), tree) as made:
            while names and settled(made):
                yield measured(attack_of(names.pop(0), made), made, seconds)


def _print(found: Found) -> bool:
    print(row(found), flush=True)
    return bool(found.faults)


def row(found: Found) -> str:
    answers = ", ".join(f"{status or 'none'}: {count}" for status, count in sorted(found.statuses.items()))
    cells = (f"{p99(found.health_s):.2f}", f"{p99(found.listing_s):.2f}", f"{found.rss_mib:.0f}", str(found.threads))
    return f"| {found.name} | {answers} | {' | '.join(cells)} | {'; '.join(found.faults) or 'held'} |"


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m tests.abuse", description=__doc__)
    parser.add_argument("--seconds", type=float, default=10, help="of each attack")
    parser.add_argument("--only", default="", help="a part of the names of the attacks to run")
    parser.add_argument("--tree", type=Path, default=ROOT, help="checkout whose service is abused")
    return parser


if __name__ == "__main__":
    sys.exit(main())
