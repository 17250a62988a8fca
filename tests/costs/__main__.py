"""`python -m tests.costs`: a table of every route's cost at several sizes of the store."""

from __future__ import annotations

import argparse
import sys
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory

from tests.costs.budgets import READS, WRITES
from tests.costs.filling import Size
from tests.costs.measuring import Cost, measured


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--jobs", type=int, nargs="+", default=[0, 1000, 20_000], help="numbers of jobs")
    parser.add_argument("--projects", type=int, default=1000, help="projects of the larger stores")
    parser.add_argument("--assets", type=int, default=10_000, help="assets of the larger stores")
    parser.add_argument("--database", choices=["sqlite", "postgresql"], default="sqlite")
    parser.add_argument("--only", default="", help="a part of the request")
    asked = parser.parse_args()
    sizes = [Size(max(40, jobs), asked.projects if jobs else 1, asked.assets if jobs else 1) for jobs in asked.jobs]
    columns = [_costs(size, asked.database, asked.only) for size in sizes]
    _print(asked.jobs, columns)


def _costs(size: Size, database: str, only: str) -> dict[str, Cost]:
    with ExitStack() as opened:
        home = Path(opened.enter_context(TemporaryDirectory()))
        url = ""
        if database == "postgresql":
            from tests.real.postgres import Postgres

            server = Postgres()
            server.start()
            opened.callback(server.close)
            url = server.fresh()
        service = opened.enter_context(measured(home, size, url))
        asks = [ask for ask in (*READS, *WRITES) if only in ask.request]
        found = {}
        for ask in asks:
            found[f"{ask.request} ({ask.who})"] = service.cost(ask)
            print(".", end="", file=sys.stderr, flush=True)
        return found


def _print(jobs: list[int], columns: list[dict[str, Cost]]) -> None:
    print("| request | status | queries | 1,000 steps of SQLite | ms |")
    print(f"| at {', '.join(f'{number:,}' for number in jobs)} jobs | | | | |\n|---|---|---|---|---|")
    for name in columns[0]:
        costs = [column[name] for column in columns]
        cells = (
            str(costs[-1].status), ", ".join(str(cost.queries) for cost in costs),
            ", ".join(f"{cost.steps / 1000:.1f}" for cost in costs),
            ", ".join(f"{1000 * cost.seconds:.0f}" for cost in costs),
        )  # fmt: skip
        print(f"| {name} | {' | '.join(cells)} |")


if __name__ == "__main__":
    main()
