"""Comparison of stills with EbSynth's CPU build on EbSynth's own examples: CPU seconds and similarity to the style.

All parameters except the guides and their weights have their defaults. EbSynth is taken from the PATH (`bin/ebsynth` of
a build of its repository, with `examples` beside `bin`). `style_fidelity.py` in a `shared` folder beside the project
measures both results. Missing parts are reported and skipped.
"""

from __future__ import annotations

import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import cv2

from benchmarks.analogy_renders import Memory, render
from benchmarks.clips import read_picture
from pipeline.methods.analogy import AnalogyParams

TOOL = Path(__file__).resolve().parents[2] / "shared" / "tools" / "style_fidelity.py"


@dataclass(frozen=True)
class Still:
    """An example of EbSynth: image names without the prefixes "source_" and "target_", and EbSynth's weights."""

    folder: str
    style: str
    guides: tuple[tuple[str, float], ...]
    """Image name -> weight, the same in both programs. The first image is our video, the others are guides a and b."""
    options: tuple[str, ...] = ()


STILLS = (
    Still("facestyle", "painting", (("Gapp", 2.0), ("Gseg", 1.5), ("Gpos", 1.5))),
    Still("facestyle", "painting", (("Gapp", 0.5), ("Gseg", 1.5), ("Gpos", 10.0))),
    Still("stylit", "style", (("fullgi", 0.66), ("dirdif", 0.66), ("indirb", 0.66))),
    Still("texbynum", "photo", (("segment", 1.0),), ("-patchsize", "3", "-uniformity", "1000")),
)


def ours(still: Still, examples: Path, out: Path) -> float:
    """Write our still to `out`; its CPU seconds."""
    folder = examples / still.folder
    inputs = {"style_output": [read_picture(folder / f"source_{still.style}.png")]}
    weights = {}
    for (name, weight), (video, style, parameter) in zip(still.guides, _NAMES, strict=False):
        weights[parameter] = weight
        inputs |= {
            video: [read_picture(folder / f"target_{name}.png")],
            style: [read_picture(folder / f"source_{name}.png")],
        }
    render(Memory(AnalogyParams(**weights, levels=2, iterations=1), inputs))  # compiles
    context = Memory(AnalogyParams(**weights), inputs)
    start = time.process_time()
    picture = render(context)[0]
    cv2.imwrite(str(out), cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))
    return time.process_time() - start


_NAMES = (
    ("video", "style", "guide_weight"),
    ("guide_a", "style_guide_a", "guide_a_weight"),
    ("guide_b", "style_guide_b", "guide_b_weight"),
)
"""Our inputs for a guide and its counterpart, and the parameter with its weight."""


def theirs(still: Still, program: str, examples: Path, out: Path) -> float:
    """Write EbSynth's still to `out`; its CPU seconds."""
    guides = [("-guide", f"source_{name}.png", f"target_{name}.png", "-weight", str(w)) for name, w in still.guides]
    command = [program, "-style", f"source_{still.style}.png", *(part for guide in guides for part in guide)]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(
        [*command, *still.options, "-output", str(out), "-backend", "cpu"], check=True, cwd=examples / still.folder,
        stdout=subprocess.DEVNULL, env={**os.environ, "OMP_NUM_THREADS": str(os.cpu_count())},
    )  # fmt: skip
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def _likeness(style: Path, outputs: list[Path]) -> list[Mapping[str, float]]:
    if not TOOL.is_file():
        return [{} for _ in outputs]
    done = subprocess.run([sys.executable, TOOL, style, *outputs, "--json"], check=True, capture_output=True)
    found: list[Mapping[str, float]] = json.loads(done.stdout)
    return found


def _row_text(seconds: float, likeness: Mapping[str, float]) -> str:
    figures = "  ".join(f"{name} {likeness[name]:.3g}" for name in ("fidelity", "variety", "palette_mean") if likeness)
    return f"{seconds:6.1f} CPU s  {figures}"


def main(names: tuple[str, ...] = ()) -> None:
    """Print the comparison, for all examples or those named."""
    program = shutil.which("ebsynth")
    examples = Path(program).resolve().parents[1] / "examples" if program else Path()
    if program is None or not examples.is_dir():
        print("EbSynth is not on the PATH: its examples are left out.")
        return
    for still in STILLS:
        if names and still.folder not in names:
            continue
        with tempfile.TemporaryDirectory() as folder:
            mine, other = Path(folder) / "ours.png", Path(folder) / "theirs.png"
            seconds = ours(still, examples, mine), theirs(still, program, examples, other)
            style = examples / still.folder / f"source_{still.style}.png"
            rows = [_row_text(s, row) for s, row in zip(seconds, _likeness(style, [mine, other]), strict=True)]
        print(f"{still.folder:>10}  ours    {rows[0]}")
        print(f"{'':>10}  EbSynth {rows[1]}   {seconds[1] / seconds[0]:.1f} times ours")


if __name__ == "__main__":
    main(tuple(sys.argv[1:]))
