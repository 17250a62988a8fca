"""Results of fuzzing: one JSON line per run in ledger.jsonl beside this file, and their sum."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path

FILE = Path(__file__).with_name("ledger.jsonl")


@dataclass
class Run:
    """One run of one target.

    Attributes:
        first, steps: numbers of its steps: [first, first + steps). A step is one case of each kind.
        outcomes: outcome -> number of cases.
        findings: cases that ended otherwise than they may, by id, with what happened.
        slowest_s: wall time of the slowest case.
    """

    target: str
    date: str
    commit: str
    seed: int
    first: int
    steps: int = 0
    cases: int = 0
    outcomes: dict[str, int] = field(default_factory=dict)
    findings: dict[str, str] = field(default_factory=dict)
    slowest_s: float = 0.0

    def count(self, outcome: str, took_s: float) -> None:
        self.cases += 1
        self.outcomes[outcome] = self.outcomes.get(outcome, 0) + 1
        self.slowest_s = round(max(self.slowest_s, took_s), 2)


def append(run: Run, file: Path = FILE) -> None:
    """Add a run."""
    with file.open("a") as sink:
        sink.write(json.dumps(asdict(run)) + "\n")


def runs(file: Path = FILE) -> list[Run]:
    """Every run so far, oldest first."""
    lines = file.read_text().splitlines() if file.exists() else []
    return [Run(**json.loads(line)) for line in lines]


def table(found: list[Run]) -> str:
    """Cases and findings by target, as Markdown."""
    rows: dict[str, list[Run]] = {}
    for run in found:
        rows.setdefault(run.target, []).append(run)
    text = ["| target | runs | cases | findings | slowest case, s |", "|---|---|---|---|---|"]
    for target, mine in sorted(rows.items()):
        cases, findings = sum(run.cases for run in mine), sum(len(run.findings) for run in mine)
        slowest_s = max(run.slowest_s for run in mine)
        text.append(f"| {target} | {len(mine)} | {cases} | {findings} | {slowest_s:.1f} |")
    return "\n".join(text)
