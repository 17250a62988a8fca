"""`python -m tests.chaos --seeds 10 --faults 12 --away 5 20`: many runs, and a table of what they have shown.

`--only kill_worker` does one fault again and again, `--cluster` lets tasks run on a Ray cluster of several nodes.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import pipeline.methods
from pipeline.video.probe import probe
from tests.chaos.faults import BY_NAME, FAULTS, OF_A_CLUSTER, OF_ROOT, SHAPES, Scene
from tests.chaos.raylets import Raylets
from tests.chaos.run import Outcome, run, submit
from tests.real.postgres import Postgres
from tests.real.swift import Swift
from tests.workers.real_farm import real_settings
from tests.workers.toy import Toy, ToyRunner
from workers import farm as farm_module
from workers.blobs.open import open_blobs
from workers.farm import Farm
from workers.pools.local_pool import LocalPool
from workers.settings import FarmSettings


def main() -> None:
    """Exit status 1 if anything was lost."""
    given = _parser().parse_args()
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
    _print(found)
    if any(outcome.lost or outcome.running or outcome.twice or outcome.orphans for outcome in found):
        sys.exit(1)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=10, help="runs, one a seed")
    parser.add_argument("--first", type=int, default=1, help="the first seed")
    parser.add_argument("--faults", type=int, default=13, help="faults a run")
    parser.add_argument("--only", nargs="+", choices=sorted(BY_NAME), help="these faults; else all that can be done")
    parser.add_argument("--cluster", action="store_true", help="tasks run on a Ray cluster of several nodes")
    parser.add_argument("--away", type=float, nargs=2, default=(0.5, 5.0), help="s that stores stay away")
    return parser


def _runs(given: argparse.Namespace, folder: Path, postgres: Postgres, s3: Swift) -> list[Outcome]:
    expected = undisturbed(folder)
    found = []
    raylets = Raylets() if given.cluster else None
    for seed in range(given.first, given.first + given.seeds):
        place = folder / f"run-{seed}"
        place.mkdir()
        settings = real_settings(postgres, s3, place / "home")
        began, away = time.monotonic(), tuple(given.away)
        faults = _faults(given)
        found.append(run(settings, place, postgres, s3, expected, seed, given.faults, away, faults, raylets))
        print(f"seed {seed}: {time.monotonic() - began:.0f} s, lost {found[-1].lost}", flush=True)
    if raylets is not None:
        raylets.close()
    return found


def _faults(given: argparse.Namespace) -> tuple[Callable[[Scene], None], ...]:
    if given.only:
        return tuple(BY_NAME[name] for name in given.only)
    return (*FAULTS, *(OF_A_CLUSTER if given.cluster else ()), *(() if os.getuid() else OF_ROOT))


def undisturbed(folder: Path) -> list[bytes]:
    """Results of the jobs on a local disk with SQLite, without faults."""
    settings = FarmSettings(home=folder / "quiet", workers=2, reserve_bytes=0)
    blobs = open_blobs(settings)
    farm = Farm(settings, LocalPool(lambda: ToyRunner(blobs), 2))
    farm.start()
    made = []
    for shape in SHAPES:
        job_id = submit(farm, folder, {**shape, "sleep_s": 0.0})
        while not farm.jobs.get(job_id).state.final:
            farm.jobs.wait_for_event(job_id, 0, 0.05)
            time.sleep(0.02)
        made.append(b"".join(farm.files.read(farm.files.get(job_id, "result"))))
    farm.stop()
    return made


def _print(found: list[Outcome]) -> None:
    faults: Counter[str] = sum((outcome.faults for outcome in found), Counter())
    runs = Counter(name for outcome in found for name in outcome.faults)
    print("\n| fault | times | runs with it |\n|---|---|---|")
    for name, times in sorted(faults.items()):
        print(f"| {name.replace('_', ' ')} | {times} | {runs[name]} |")
    attempts: Counter[str] = sum((outcome.attempts for outcome in found), Counter())
    print(f"\n{len(found)} runs, {sum(outcome.jobs for outcome in found)} jobs; attempts: {dict(attempts)}")
    for name in ("lost", "running", "twice", "orphans"):
        print(f"{name}: {sum(getattr(outcome, name) for outcome in found)}")


if __name__ == "__main__":
    main()
