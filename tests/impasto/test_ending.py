"""Exit of the command's process."""

from __future__ import annotations

import subprocess
import sys

_PROGRAM = """
import sys, threading, time
import cv2
import numpy as np
from impasto.cli import app
from workers.process.starting import WARM_UP_THREAD

def load():
    picture = np.zeros((600, 600, 3), np.uint8)
    while True:
        cv2.GaussianBlur(picture, (0, 0), 3)

threading.Thread(target=load, name=WARM_UP_THREAD, daemon=True).start()
sys.argv = ["impasto", "methods", "--no-such-option"]
app.main()
"""


def test_a_command_that_ends_while_kernels_are_loaded_keeps_its_status() -> None:
    done = subprocess.run([sys.executable, "-c", _PROGRAM], capture_output=True, text=True, timeout=120)
    assert (done.returncode, "no-such-option" in done.stderr) == (2, True), done.stderr
