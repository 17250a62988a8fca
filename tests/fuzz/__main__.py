"""`python -m tests.fuzz [TARGET...] --minutes M --seed S`: fuzz, and add the counts to ledger.jsonl.

Targets: media (decoders), uploads (frames and previews of mutated uploads, by a service), requests (random requests of
every route), http (the API, by schemathesis), tus (resumable uploads against a model), messages (live
sessions) and parsers (texts of clients, to the functions that read them).
Without one, all share the minutes. Files of findings are kept in .fuzz/; `--again ID` runs one case once more, or the
step that contains it; `--table` prints what all runs have shown.
"""

from __future__ import annotations

import argparse
import asyncio
import logging
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

from tests.fuzz import http, ledger, media, messages, parsers, requests, tus, uploads
from tests.fuzz.decoding import DecodingChild

ROOT = Path(__file__).resolve().parents[2]
KEPT = ROOT / ".fuzz"
GUARDED_ONE_IN = 20
"""One step in so many decodes its files in the service's decoder processes; the others avoid the fork."""


def main() -> int:
    given = _parser().parse_args()
    logging.disable(logging.CRITICAL)
    if given.table:
        print(ledger.table(ledger.runs()))
        return 0
    if given.again:
        return _again(given.again)
    targets = given.targets or list(TARGETS)
    found = [_run(name, given.seed, 60 * given.minutes / len(targets)) for name in targets]
    print(ledger.table(found))
    return 1 if any(run.findings for run in found) else 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("targets", nargs="*", metavar="TARGET", help=" or ".join(TARGETS))
    parser.add_argument("--minutes", type=float, default=5, help="wall time of the run")
    parser.add_argument("--seed", type=int, default=0, help="a seed goes on with the case after its last in the ledger")
    parser.add_argument("--again", metavar="ID", help="run one case, for example media:mp4:0:17")
    parser.add_argument("--table", action="store_true", help="print the sums of the ledger")
    return parser


def _run(target: str, seed: int, seconds: float) -> ledger.Run:
    before = [run for run in ledger.runs() if (run.target, run.seed) == (target, seed)]
    first = max((run.first + run.steps for run in before), default=0)
    run = ledger.Run(target, datetime.now(UTC).isoformat(timespec="seconds"), _commit(), seed, first)
    deadline = time.monotonic() + seconds
    with tempfile.TemporaryDirectory(prefix="impasto-fuzz-") as folder:
        try:
            TARGETS[target](run, Path(folder), lambda: time.monotonic() < deadline)
        finally:
            ledger.append(run)
    for name, what in run.findings.items():
        print(f"{name}: {what}")
    return run


def _media(run: ledger.Run, folder: Path, goes_on: Callable[[], bool]) -> None:
    child = DecodingChild()
    while goes_on():
        for case in media.cases(run.seed, run.first + run.steps):
            began = time.monotonic()
            what = media.outcome(case, folder) if case.number % GUARDED_ONE_IN == 0 else child.outcome(case, folder)
            took_s = time.monotonic() - began
            if took_s > media.SLOW_S and not what.startswith("fault"):
                what = f"fault: it took {took_s:.0f} s"
            run.count(what.partition(":")[0], took_s)
            if what.startswith("fault"):
                run.findings[case.id] = what
                KEPT.mkdir(exist_ok=True)
                (KEPT / case.id.replace(":", "-")).write_bytes(case.data())
        run.steps += 1
    child.close()


def _again(name: str) -> int:
    target, *parts = name.split(":")
    if target in STEPS:
        run = ledger.Run(target, "", "", int(parts[0]), int(parts[1]))
        with tempfile.TemporaryDirectory(prefix="impasto-fuzz-") as folder:
            asyncio.run(STEPS[target](run, Path(folder) / "again", int(parts[1])))
        print(*(f"{case}: {what}" for case, what in run.findings.items()), sep="\n")
        return 1 if run.findings else 0
    case = media.Case.of(name)
    with tempfile.TemporaryDirectory(prefix="impasto-fuzz-") as folder:
        try:
            (path := Path(folder) / "upload").write_bytes(data := case.data())
            print(media.run(case.kind, path, data))
        except Exception:
            traceback.print_exc()
            return 1
    return 0


def _commit() -> str:
    command = ["git", "rev-parse", "--short", "HEAD"]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False).stdout.strip()


TARGETS: dict[str, Callable[[ledger.Run, Path, Callable[[], bool]], None]] = {
    "media": _media, "http": http.fuzz, "uploads": uploads.fuzz, "requests": requests.fuzz, "tus": tus.fuzz,
    "messages": messages.fuzz, "parsers": parsers.fuzz,
}  # fmt: skip

STEPS = {"requests": requests.step, "tus": tus.step, "messages": messages.step}
"""Targets whose cases depend on earlier cases of their step: a whole step is reproduced."""

if __name__ == "__main__":
    sys.exit(main())
