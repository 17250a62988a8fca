"""A farm as a process of its own, to be killed, frozen and started again: its settings come on stdin, as JSON."""

from __future__ import annotations

import sys
import threading

import pipeline.methods
from pipeline.video.probe import probe
from tests.workers.toy import Toy, ToyRunner
from workers import studio as studio_module
from workers.blobs.opened import open_blobs
from workers.local_pool import LocalPool
from workers.settings import FarmSettings
from workers.studio import Studio


def main() -> None:
    pipeline.methods.methods = lambda: {"toy": Toy()}  # type: ignore[assignment]
    studio_module.probe_guarded = probe
    settings = FarmSettings.model_validate_json(sys.stdin.readline())
    blobs = open_blobs(settings)
    farm = Studio(settings, LocalPool(lambda: ToyRunner(blobs), settings.workers))
    farm.start()
    print("up", flush=True)
    threading.Event().wait()


if __name__ == "__main__":
    main()
