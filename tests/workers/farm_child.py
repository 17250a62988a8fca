"""A farm as a process of its own, to be killed, frozen and started again: its settings come on stdin, as JSON.

With the pool "none" it accepts: every further line is a request, answered with the id of the job once that is accepted.
SIGUSR1 sets its clock an hour forward, and back at the next one.
"""

from __future__ import annotations

import ctypes
import json
import signal
import sys
import threading
import time
from collections.abc import Callable
from functools import partial
from types import FrameType

import pipeline.methods
from pipeline.video.probe import probe
from tests.workers.toy import Toy, ToyRunner
from workers import farm as farm_module
from workers.blobs.base import Blobs
from workers.blobs.open import open_blobs
from workers.contract.request import JobRequest
from workers.farm import Farm
from workers.pools.base import Pool
from workers.pools.child_runner import ChildRunner
from workers.pools.local_pool import LocalPool
from workers.settings import FarmSettings

STEP_S = 3600.0
_PR_SET_PDEATHSIG = 1
_system_time = time.time
_ahead_s = 0.0


def main() -> None:
    run(sys.stdin.readline(), lambda: print("up", flush=True))


def run(settings_json: str, when_up: Callable[[], object]) -> None:
    """Main function of the process; `when_up` is called once it works."""
    pipeline.methods.methods = lambda: {"toy": Toy()}  # type: ignore[assignment]
    farm_module.probe_guarded = probe
    time.time = lambda: _system_time() + _ahead_s
    signal.signal(signal.SIGUSR1, _step)
    settings = FarmSettings.model_validate_json(settings_json)
    farm = Farm(settings, _pool(settings, open_blobs(settings)))
    farm.start()
    when_up()
    if settings.pool == "none":
        _accept(farm)
    threading.Event().wait()


def run_forked(settings_json: str, when_up: Callable[[], object]) -> None:
    """Call `run` in a forked process that ends with its parent."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    run(settings_json, when_up)


def _step(number: int, frame: FrameType | None) -> None:
    global _ahead_s
    _ahead_s = 0.0 if _ahead_s else STEP_S


def _pool(settings: FarmSettings, blobs: Blobs) -> Pool | None:
    if settings.pool == "none":
        return None
    if settings.pool == "local":
        return LocalPool(lambda number: ChildRunner(partial(ToyRunner, blobs)), settings.workers)
    from workers.pools.ray_pool import RayPool

    return RayPool(blobs, settings, ToyRunner)


def _accept(farm: Farm) -> None:
    for line in sys.stdin:
        asked = json.loads(line)
        request = JobRequest("toy", {"data": asked["asset"]}, asked["params"], seed=7)
        print(farm.jobs.submit(request, idempotency_key=asked["key"]).id, flush=True)


if __name__ == "__main__":
    main()
