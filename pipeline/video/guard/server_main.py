"""Entry point of the decoder server: `python -m pipeline.video.guard.server_main FD`, with its end of a socket."""

from __future__ import annotations

import gc
import os
import socket
import sys


def main(fd: int) -> None:
    # Before NumPy is imported: its threads would not survive a fork.
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ[name] = "1"
    gc.disable()  # collections among imported objects take time, and find nothing
    from pipeline.video.guard.roles import serve

    gc.freeze()
    gc.enable()
    serve(socket.socket(fileno=fd))


if __name__ == "__main__":
    main(int(sys.argv[1]))
