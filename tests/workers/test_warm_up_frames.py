"""After the warm-up all kernels are compiled: the first frame takes as long as later ones, and can be cancelled."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PROGRAM = """
import gc
from numba.core.dispatcher import Dispatcher
from pipeline.methods import methods
from pipeline.scenes import scene
from workers.execution.warm_up import warm_up_process

def compiled():
    kernels = [thing for thing in gc.get_objects() if isinstance(thing, Dispatcher)]
    return {f"{kernel.py_func.__name__}{signature}" for kernel in kernels for signature in kernel.signatures}

warm_up_process()
warmed = compiled()
for size in ((320, 240), (640, 480)):
    shot = scene("cut", size=size, frames=6)
    frames = [shot.image(index) for index in range(6)]
    for method in methods().values():
        if session := method.stream(method.Params(), size, 0, {}):
            for frame in frames:
                session.step(frame)
print(*compiled() - warmed, sep="\\n", end="")
"""


def test_the_warm_up_compiles_every_kernel() -> None:
    done = subprocess.run([sys.executable, "-c", PROGRAM], cwd=ROOT, capture_output=True, text=True, timeout=240)
    assert done.returncode == 0, done.stderr
    assert done.stdout == ""
