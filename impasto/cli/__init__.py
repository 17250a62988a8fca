"""The `impasto` command: one file per command, and shared helpers."""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
"""Read when NumPy is imported, by this process and its children. Every copy of OpenBLAS (NumPy's and OpenCV's) would
start a thread for each processor, which is busy while it waits for work: 0.2 s of processor time a render. Our matrices
are small."""
