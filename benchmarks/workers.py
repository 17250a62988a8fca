"""Speedup of two workers over one for a video of several shots. Each turn is a fresh `impasto render`.

A single worker uses several threads, so two workers cannot be twice as fast on a machine with two processors.
"""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from benchmarks.loops import source

CLIP, SIZE = "bikes_scene_cuts.mp4", "640x272"
TURNS = 3


def main() -> None:
    """Print the medians and their ratio."""
    with tempfile.TemporaryDirectory(prefix="impasto-workers-") as scratch:
        folder = Path(scratch)
        clip = source(CLIP, SIZE, folder)
        turns = [(render(clip, folder, 1), render(clip, folder, 2)) for _ in range(TURNS)]
    print(f"{turns[0][0]['frames']} frames, {turns[0][0]['width']}x{turns[0][0]['height']}")
    for field, name in (("seconds", "the method's steps"), ("wall_seconds", "the whole command")):
        one, two = ([turn[which][field] for turn in turns] for which in (0, 1))
        ratio = statistics.median(a / b for a, b in zip(one, two, strict=True))
        seconds = f"1 worker {statistics.median(one):.2f} s, 2 workers {statistics.median(two):.2f} s"
        print(f"{name:>20}: {seconds}, ratio {ratio:.2f}")


def render(clip: Path, folder: Path, workers: int) -> dict[str, Any]:
    """The output of `impasto render --json`."""
    words = [
        "render",
        clip,
        "-o",
        folder / "out.mp4",
        "--home",
        folder,
        "--workers",
        workers,
        "--overwrite",
        "--quiet",
        "--json",
    ]
    done = subprocess.run(
        [sys.executable, "-m", "impasto", *map(str, words)], capture_output=True, text=True, check=True
    )
    summary: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return summary
