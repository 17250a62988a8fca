"""Memory of a render by length of the video: 10 s against 60 s of the same looped 720p clip.

`python -m benchmarks.memory METHOD CLIP SECONDS SECONDS` measures another method and clip at other lengths.

The benchmark runs `impasto render` with one worker: decoding, painting, encoding, joining. It reports two figures: the
sampled peak of the resident set size of the process tree, and the kernel's peak (VmHWM) of the process that renders.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import av
import psutil

from benchmarks.loops import looped, source

CLIP, SIZE = "dog_720p_audio.mp4", "1280x720"
SECONDS = (10, 60)
SAMPLE_S = 0.05
MIB = 1 << 20


@dataclass(frozen=True)
class Peak:
    """Peak memory of one render, MiB."""

    frames: int
    wall_s: float
    tree_mib: float
    process_mib: float


def main(method: str = "abstraction", name: str = CLIP, *, lengths: tuple[int, ...] = SECONDS) -> None:
    """Print the peaks of both lengths and the relative growth from the shorter to the longer."""
    with tempfile.TemporaryDirectory(prefix="impasto-memory-") as scratch:
        folder = Path(scratch)
        clip = source(name, SIZE, folder)
        peaks = [measure(clip, seconds, folder, method) for seconds in lengths]
    print(f"{'video s':>8} {'frames':>7} {'wall s':>7} {'tree MiB':>9} {'process MiB':>12}")
    for seconds, peak in zip(lengths, peaks, strict=True):
        print(f"{seconds:8} {peak.frames:7} {peak.wall_s:7.1f} {peak.tree_mib:9.0f} {peak.process_mib:12.0f}")
    short, long = peaks
    tree, process = long.tree_mib / short.tree_mib - 1, long.process_mib / short.process_mib - 1
    print(f"growth: tree {tree:+.1%}, process {process:+.1%} (at most +10 %)")


def measure(clip: Path, seconds: int, folder: Path, method: str) -> Peak:
    """Render the first `seconds` of `clip` in an endless loop; peak memory."""
    with av.open(str(clip)) as video:
        frames = round(seconds * (video.streams.video[0].average_rate or 25))
    long = looped(clip, frames, folder / f"{seconds}.mp4")
    words = ["render", long, "-o", folder / "out.mp4", "--home", folder / "home", "--quiet", "--method", method]
    began = time.monotonic()
    tree, process = _peaks([sys.executable, "-m", "impasto", *map(str, words)])
    return Peak(frames, time.monotonic() - began, tree / MIB, process / MIB)


def _peaks(command: list[str]) -> tuple[int, int]:
    """Run a command; (sampled peak of its process tree, the kernel's peak of the process itself), bytes."""
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    peak = 0
    while True:
        pid, status, usage = os.wait4(process.pid, os.WNOHANG)
        if pid:
            break
        peak = max(peak, _resident(psutil.Process(process.pid)))
        time.sleep(SAMPLE_S)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"impasto render failed with {process.returncode}.")
    return peak, usage.ru_maxrss * 1024


def _resident(root: psutil.Process) -> int:
    """Present resident set size of a process and its descendants, bytes."""
    total = 0
    for process in (root, *root.children(recursive=True)):
        try:
            total += process.memory_info().rss
        except psutil.NoSuchProcess:
            continue
    return total


if __name__ == "__main__":
    words = sys.argv[1:]
    main(*words[:2], lengths=tuple(map(int, words[2:])) or SECONDS)
