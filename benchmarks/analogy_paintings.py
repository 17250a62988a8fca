"""Flicker and legibility of live-action clips stylised from a painting alone: all paintings of the media folder, three
clips.

`python -m benchmarks.analogy_paintings [--frames N] [PART ...]` prints one row for each painting and clip: flicker
relative to the video, flicker relative to frames synthesised independently, structure, and the fraction of the video's
faces that are still detected. PARTs select the rows whose painting and clip names contain all of them. The tools
in a `shared` folder beside the project are required.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np

from benchmarks.analogy_claims import TOOLS, asked, painted, painting, saved
from benchmarks.clips import MEDIA
from pipeline.frames import Frame
from pipeline.video.reader import VideoReader

CLIPS = (("asl_walk_640x480.mkv", 10), ("marathon_720x400.mp4", 10), ("cockatoo_720p_yuv444.mp4", 10))
"""(file, first frame): people, sport, animals."""
WIDTH_PX = 480
FRAMES = 12


def clip(name: str, start: int, count: int) -> list[Frame]:
    """Frames of a clip, `WIDTH_PX` wide."""
    with VideoReader(MEDIA / name) as reader:
        found = list(reader.read(start, start + count))
    size = (WIDTH_PX, round(found[0].shape[0] * WIDTH_PX / found[0].shape[1]))
    return [np.asarray(cv2.resize(frame, size, interpolation=cv2.INTER_AREA), np.uint8) for frame in found]


def row(name: str, style: str, source: list[Frame]) -> str:
    """The measurements of one painting and clip as a row of a Markdown table."""
    exemplar = painting(style)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        plain = saved(folder / "source", source)
        on, off = (saved(folder / how, painted(source, exemplar, temporal=how)) for how in ("on", "off"))
        steady, alone = asked("coherence.py", plain, on, off)
        faces = subprocess.run(
            [sys.executable, TOOLS / "faces.py", plain, on], check=True, capture_output=True, text=True
        ).stdout.strip()
    found = faces.rpartition("faces kept ")[2].partition(";")[0]
    share = steady["flicker"] / alone["flicker"]
    return f"| {style} | {name} | {steady['flicker']:.2f} | {share:.2f} | {steady['structure']:.2f} | {found} |"


def main() -> None:
    """Print the table, row by row."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=FRAMES, help=f"frames of each clip, {FRAMES} by default")
    parser.add_argument("parts", nargs="*", metavar="PART")
    args = parser.parse_args()
    folder = MEDIA.parent / "style" / "paintings"
    if not folder.is_dir() or not TOOLS.is_dir():
        sys.exit("The media folder or the tools beside the project are missing.")
    print("| painting | clip | flicker | share | structure | faces |\n|---|---|---|---|---|---|")
    for name, start in CLIPS:
        source = clip(name, start, args.frames)
        for style in sorted(path.stem for path in folder.glob("*.jpg")):
            if all(part in name or part in style for part in args.parts):
                print(row(name, style, source), flush=True)


if __name__ == "__main__":
    main()
