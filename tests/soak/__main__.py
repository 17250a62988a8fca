"""`python -m tests.soak --minutes 60`: a service under mixed load, and a table of what grew.

Every run is added to ledger.jsonl with the slopes of all measures; `--table` prints the runs so far. Exit status 1 if
something grew (see `measure.Trend.grows`) or an answer blamed the service.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections import Counter
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import psutil

from tests.chaos.__main__ import commit
from tests.e2e.processes import Service
from tests.soak.load import Load, failures, wait
from tests.soak.measure import Sampler, Trend, trend

LEDGER = Path(__file__).with_name("ledger.jsonl")


def main() -> int:
    given = _parser().parse_args()
    if given.table:
        print("\n\n".join(_table(json.loads(line)) for line in LEDGER.read_text().splitlines()))
        return 0
    with tempfile.TemporaryDirectory(prefix="impasto-soak-") as folder:
        run = _soak(Path(folder), given)
    with LEDGER.open("a") as sink:
        sink.write(json.dumps(run) + "\n")
    print(_table(run))
    return 1 if run["failures"] or any(row["grows"] for row in run["measures"].values()) else 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m tests.soak", description=__doc__)
    parser.add_argument("--minutes", type=float, default=60, help="of load")
    parser.add_argument("--every", type=float, default=10, help="seconds between two samples")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--pause", type=float, default=0.0, help="seconds between two pieces of work of one kind")
    parser.add_argument("--table", action="store_true", help="print the runs of the ledger")
    return parser


def _soak(folder: Path, given: argparse.Namespace) -> dict[str, Any]:
    seconds = 60 * given.minutes
    service = Service(folder, "local")
    process = service.start()
    try:
        service.wait_ready()
        load = Load(service.url, given.seed, given.pause)
        sampler = Sampler(psutil.Process(process.pid), folder, service.url)
        load.start()
        wait(seconds, given.every, sampler.sample)
        load.stop()
    finally:
        service.stop()
    found = {name: (series, trend(series)) for name, series in sampler.series.items()}
    return {
        "date": datetime.now(UTC).isoformat(timespec="seconds"), "commit": commit(), "seed": given.seed,
        "pause_s": given.pause, "minutes": round(seconds / 60, 1), "load_average": psutil.getloadavg()[1],
        "done": dict(sorted(load.done.items())), "failures": failures(load.done),
        "measures": {name: _row(series.values, line) for name, (series, line) in found.items()},
    }  # fmt: skip


def _row(values: list[float], line: Trend | None) -> dict[str, Any]:
    row: dict[str, Any] = {"samples": len(values), "first": round(values[0], 2), "last": round(values[-1], 2)}
    if line is not None:
        row |= {"mean": round(line.mean, 2), "per_hour": round(line.per_hour, 2), "error": round(line.error, 2)}
    return row | {"grows": line is not None and line.grows}


def _table(run: dict[str, Any]) -> str:
    head = f"{run['date']}, {run['minutes']} minutes, load average {run['load_average']:.0f}, commit {run['commit']}"
    text = [
        head,
        "",
        "| measure | first | last | mean | slope/h | standard error | grows |",
        "|---|" + 6 * "---|",
    ]
    for name, row in run["measures"].items():
        cells = [row["first"], row["last"], *(row.get(key, "-") for key in ("mean", "per_hour", "error"))]
        text.append(f"| {name} | {' | '.join(map(str, cells))} | {'yes' if row['grows'] else 'no'} |")
    done: Counter[str] = Counter(run["done"])
    text += ["", "Done: " + ", ".join(f"{name}: {times}" for name, times in done.items())]
    return "\n".join(text)


if __name__ == "__main__":
    sys.exit(main())
