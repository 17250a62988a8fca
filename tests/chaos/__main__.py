"""`python -m tests.chaos --seeds 10 --faults 12 --away 5 20`: many runs, and a table of what they have shown.

`--tiny --rounds 10` submits forty jobs of milliseconds before each fault instead of three longer ones; `--together 4`
injects faults into up to four components at once; `--only FAULT` does one fault again and again; `--cluster` lets tasks
run on several Ray nodes; `--older COMMIT` lets one of the two workers run the program of that commit; `--disk` keeps
blobs in a folder instead of S3. Every run is added to ledger.jsonl; `--table` prints what all runs have shown.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from pathlib import Path

import pipeline.methods
from pipeline.video.probe import probe
from tests.chaos import ledger
from tests.chaos.faults import BY_NAME, FAULTS, OF_A_CLUSTER, OF_ROOT, OF_S3, SHAPES, TINY, Scene, Shape
from tests.chaos.raylets import Raylets
from tests.chaos.run import Outcome, Plan, run, submit
from tests.real.postgres import Postgres
from tests.real.swift import Swift
from tests.workers.real_farm import real_settings
from tests.workers.toy import Toy, ToyRunner
from workers import farm as farm_module
from workers.blobs.open import open_blobs
from workers.farm import Farm
from workers.pools.local_pool import LocalPool
from workers.settings import FarmSettings

ROOT = Path(__file__).resolve().parents[2]
_ON_DISK = {"blob_url": "", "s3_endpoint_url": ""}


def main() -> None:
    """Exit status 1 if anything was lost."""
    given = _parser().parse_args()
    if given.table:
        print(ledger.table(ledger.records()))
        return
    pipeline.methods.methods = lambda: {"toy": Toy()}  # type: ignore[assignment]
    farm_module.probe_guarded = probe
    postgres, s3 = Postgres(), Swift()
    postgres.start()
    s3.start()
    try:
        with tempfile.TemporaryDirectory(prefix="impasto-chaos-") as folder:
            found = _runs(given, Path(folder), postgres, s3)
    finally:
        s3.close()
        postgres.close()
    print(ledger.table(found))
    if not all(record.clean for record in found):
        sys.exit(1)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=10, help="runs, one a seed")
    parser.add_argument("--first", type=int, default=1, help="the first seed")
    parser.add_argument("--faults", type=int, default=13, help="faults a run")
    parser.add_argument("--only", nargs="+", choices=sorted(BY_NAME), help="these faults; else all that can be done")
    parser.add_argument("--tiny", action="store_true", help="many tiny jobs before each fault")
    parser.add_argument("--rounds", type=int, default=1, help="jobs of each shape before a fault")
    parser.add_argument("--together", type=int, default=1, help="faults at once, each of another component")
    parser.add_argument("--disk", action="store_true", help="blobs in a folder instead of S3")
    parser.add_argument("--older", metavar="COMMIT", help="one worker runs the program of this commit")
    parser.add_argument("--minutes", type=float, default=1e9, help="begin no run after this time")
    parser.add_argument("--table", action="store_true", help="print the sums of the ledger")
    parser.add_argument("--cluster", action="store_true", help="tasks run on a Ray cluster of several nodes")
    parser.add_argument("--away", type=float, nargs=2, default=(0.5, 5.0), help="s that stores stay away")
    return parser


def _runs(given: argparse.Namespace, folder: Path, postgres: Postgres, s3: Swift) -> list[ledger.Record]:
    shapes = TINY if given.tiny else SHAPES
    expected = undisturbed(folder, shapes)
    older = _extracted(given.older, folder / "older") if given.older else None
    found: list[ledger.Record] = []
    raylets = Raylets() if given.cluster else None
    until = time.monotonic() + 60 * given.minutes
    for seed in range(given.first, given.first + given.seeds):
        if time.monotonic() > until:
            break
        place = folder / f"run-{seed}"
        place.mkdir()
        settings = real_settings(postgres, s3, place / "home", **(_ON_DISK if given.disk else {}))
        plan = Plan(
            seed, given.faults, tuple(given.away), _faults(given), shapes, given.rounds, raylets, older, given.together
        )
        began = time.monotonic()
        outcome = run(settings, place, postgres, s3, expected, plan)
        found.append(_record(_setup(given), seed, outcome, time.monotonic() - began))
        ledger.append(found[-1])
        print(f"seed {seed}: {found[-1].seconds:.0f} s, {outcome.jobs} jobs, lost {outcome.lost}", flush=True)
        shutil.rmtree(place, ignore_errors=True)
    if raylets is not None:
        raylets.close()
    return found


def _record(setup: str, seed: int, outcome: Outcome, seconds: float) -> ledger.Record:
    shown = (outcome.lost, outcome.running, outcome.twice, outcome.orphans)
    date, faults, attempts = (
        datetime.now(UTC).isoformat(timespec="seconds"),
        dict(outcome.faults),
        dict(outcome.attempts),
    )
    return ledger.Record(date, commit(), setup, seed, faults, outcome.jobs, attempts, *shown, round(seconds, 1))


def _setup(given: argparse.Namespace) -> str:
    parts = ["PostgreSQL", "folder" if given.disk else "S3"]
    parts += ["two raylets"] if given.cluster else []
    parts += [f"one worker of {given.older}"] if given.older else []
    parts += [f"{given.together} faults at once"] if given.together > 1 else []
    return ", ".join([*parts, "tiny jobs" if given.tiny else "jobs of seconds"])


def _extracted(revision: str, folder: Path) -> Path:
    """Export the repository at a commit."""
    folder.mkdir()
    archive = subprocess.run(["git", "archive", revision], cwd=ROOT, capture_output=True, check=True).stdout
    subprocess.run(["tar", "-x"], cwd=folder, input=archive, check=True)
    return folder


def commit() -> str:
    """The commit that is checked out."""
    command = ["git", "rev-parse", "--short", "HEAD"]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False).stdout.strip()


def _faults(given: argparse.Namespace) -> tuple[Callable[[Scene], None], ...]:
    if given.only:
        return tuple(BY_NAME[name] for name in given.only)
    found = [*FAULTS, *(() if given.disk else OF_S3), *(OF_A_CLUSTER if given.cluster else ())]
    return (*found, *(() if os.getuid() or given.disk else OF_ROOT))


def undisturbed(folder: Path, shapes: Sequence[Shape] = SHAPES) -> list[bytes]:
    """Results of the jobs in a run without faults, on a local disk with SQLite."""
    settings = FarmSettings(home=folder / "quiet", workers=2, reserve_bytes=0)
    blobs = open_blobs(settings)
    farm = Farm(settings, LocalPool(lambda number: ToyRunner(blobs), 2))
    farm.start()
    made = []
    for shape in shapes:
        job_id = submit(farm, folder, {**shape, "sleep_s": 0.0})
        while not farm.jobs.get(job_id).state.final:
            farm.jobs.wait_for_event(job_id, 0, 0.05)
            time.sleep(0.02)
        made.append(b"".join(farm.files.read(farm.files.get(job_id, "result"))))
    farm.stop()
    return made


if __name__ == "__main__":
    main()
