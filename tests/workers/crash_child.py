"""A process that tests kill: opens the farm of a home, submits the job once, and works until it is done."""

from __future__ import annotations

import sys
from pathlib import Path

import pipeline.methods
from pipeline.video.probe import probe
from tests.workers.toy import Toy, ToyRunner
from workers import farm as farm_module
from workers.blobs.disk import DiskBlobs
from workers.contract.request import JobRequest
from workers.farm import Farm
from workers.pools.local_pool import LocalPool
from workers.settings import FarmSettings

PARAMS = {"tasks": 12, "sleep_s": 0.05, "chain": True}
KEY = "the-job"


def main(home: Path) -> None:
    pipeline.methods.methods = lambda: {"toy": Toy()}  # type: ignore[assignment]
    farm_module.probe_guarded = probe
    settings = FarmSettings(home=home, workers=2, reserve_bytes=0, lease_s=600)
    blobs = DiskBlobs(settings.blobs_at)
    farm = Farm(settings, LocalPool(lambda number: ToyRunner(blobs), 2))
    data = home / "data.json"
    data.write_text("{}")
    asset = farm.assets.add(data, "data.json")
    job = farm.jobs.submit(JobRequest("toy", {"data": asset.id}, PARAMS, seed=3), idempotency_key=KEY)
    farm.start()
    print(job.id, flush=True)
    last_seq = 0
    while not farm.jobs.get(job.id).state.final:
        farm.jobs.wait_for_event(job.id, last_seq, 1.0)
        last_seq = max((event.seq for event in farm.jobs.events(job.id, last_seq)[0]), default=last_seq)
        print(f"done {farm.jobs.get(job.id).counts['succeeded']}", flush=True)
    farm.stop()


if __name__ == "__main__":
    main(Path(sys.argv[1]))
