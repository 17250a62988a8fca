"""Results of chaos runs: one JSON line per run in ledger.jsonl beside this file, and their sum."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import asdict, dataclass
from pathlib import Path

FILE = Path(__file__).with_name("ledger.jsonl")


@dataclass(frozen=True)
class Record:
    """A run.

    Attributes:
        setup: stores, and where tasks ran.
        faults: fault -> times.
        jobs: accepted jobs.
        lost, running, twice, orphans: as `tests.chaos.run.Outcome`; each must be 0.
        seconds: wall time.
    """

    date: str
    commit: str
    setup: str
    seed: int
    faults: dict[str, int]
    jobs: int
    attempts: dict[str, int]
    lost: int
    running: int
    twice: int
    orphans: int
    seconds: float

    @property
    def clean(self) -> bool:
        return not (self.lost or self.running or self.twice or self.orphans)


def append(record: Record, file: Path = FILE) -> None:
    """Add a run."""
    with file.open("a") as sink:
        sink.write(json.dumps(asdict(record)) + "\n")


def records(file: Path = FILE) -> list[Record]:
    """Every run so far, oldest first."""
    lines = file.read_text().splitlines() if file.exists() else []
    return [Record(**json.loads(line)) for line in lines]


def table(found: list[Record]) -> str:
    """Faults by kind, and sums by setup, as Markdown."""
    faults: Counter[str] = sum((Counter(record.faults) for record in found), Counter())
    text = ["| fault | times | runs with it |", "|---|---|---|"]
    for name, times in sorted(faults.items()):
        text.append(f"| {name.replace('_', ' ')} | {times} | {sum(name in record.faults for record in found)} |")
    text += [
        "",
        "| setup | runs | faults | jobs | lost | twice | left running | orphans |",
        "|---|---|---|---|---|---|---|---|",
    ]
    setups = sorted({record.setup for record in found})
    rows = [(setup, [record for record in found if record.setup == setup]) for setup in setups]
    for setup, mine in [*rows, ("sum", found)]:
        sums = [
            sum(getattr(record, name) for record in mine) for name in ("jobs", "lost", "twice", "running", "orphans")
        ]
        times = sum(sum(record.faults.values()) for record in mine)
        text.append(f"| {setup} | {len(mine)} | {times} | {' | '.join(map(str, sums))} |")
    return "\n".join(text)
