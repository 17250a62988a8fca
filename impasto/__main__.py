"""Entry point of the `impasto` command, also as `python -m impasto`."""

from __future__ import annotations

import os
import sys

import impasto.own_packages  # noqa: F401 (before the first import of one of them)
from workers.process.starting import without_garbage_collection


def main() -> None:
    """Run the command line. For `impasto render`, another process watches this one, and the decoder server starts
    beside the imports, which take about as long as its own."""
    # Read when NumPy is imported, by this process and its children. Every copy of OpenBLAS (NumPy's and OpenCV's) would
    # start a thread for each processor, which is busy while it waits for work: 0.2 s of processor time a render. Our
    # matrices are small.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    with without_garbage_collection():
        if sys.argv[1:2] == ["render"] and not {"-h", "--help"} & set(sys.argv):
            from impasto.cli import supervisor

            supervisor.watch_from_here()
            from pipeline.video.guard.decoder_server import start_decoder_server

            start_decoder_server()
        from impasto.cli.app import main as run

    run()


if __name__ == "__main__":
    main()
