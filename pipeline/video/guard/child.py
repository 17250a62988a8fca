"""The nursery as a process: `python -m pipeline.video.guard.child FD`, FD being its end of a socket to us."""

from __future__ import annotations

import os
import socket
import sys


def main(fd: int) -> None:
    # Before NumPy comes: its threads would not survive a fork. This is the entry of a process.
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ[name] = "1"
    from pipeline.video.guard.roles import nursery

    nursery(socket.socket(fileno=fd))


if __name__ == "__main__":
    main(int(sys.argv[1]))
