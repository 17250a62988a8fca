"""Seconds a frame of the analogy method by size and stage, and its still against EbSynth's CPU build if that is there.

The paper's settings: 9x9 patches, four levels, one pair of sweeps. EbSynth's binary is taken from the PATH; without it
only our own time is printed.
"""

from __future__ import annotations

import shutil
import subprocess
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.clips import clip
from pipeline.frames import Frame
from pipeline.methods.analogy import Analogy, AnalogyParams
from pipeline.methods.base import Arrays, Brief, Note, VideoInfo
from pipeline.scenes import scene

SIZES = ((640, 480), (1280, 720), (1920, 1080))
FRAMES = 3


class Memory:
    """A bench in memory that times its stages, wall seconds."""

    def __init__(self, params: AnalogyParams, inputs: Mapping[str, list[Frame]]) -> None:
        self.params, self.seed, self.inputs = params, 0, inputs
        height, width = inputs["video"][0].shape[:2]
        self.size = (width, height)
        count = len(inputs["video"])
        self.video = VideoInfo(width, height, count, 25.0, count / 25)
        self.step = ""
        self.kept: dict[tuple[str, str], dict[str, NDArray[Any]]] = {}
        self.painted: dict[int, Frame] = {}
        self.stages: dict[str, float] = defaultdict(float)

    def frames(self, name: str = "video", start: int = 0, stop: int | None = None) -> Iterator[Frame]:
        return iter(self.inputs[name][start:stop])

    def has(self, name: str) -> bool:
        return name in self.inputs

    def image(self, name: str) -> Frame:
        return self.inputs[name][0]

    def json(self, name: str) -> Any:
        raise KeyError(name)

    def images(self, name: str) -> Mapping[int, NDArray[Any]]:
        return dict(enumerate(self.inputs[name]))

    def save(self, name: str, arrays: Arrays) -> None:
        self.kept[self.step, name] = dict(arrays)

    def load(self, step: str, name: str) -> dict[str, NDArray[Any]]:
        return self.kept[step, name]

    def save_file(self, name: str, data: bytes, media_type: str) -> None: ...

    def wants(self, artefact: str) -> bool:
        return False

    def emit(self, index: int, frame: Frame) -> None:
        self.painted[index] = frame

    def show(self, frame: Frame) -> None: ...

    def progress(self, done: float) -> None: ...

    @contextmanager
    def clock(self, stage: str) -> Iterator[None]:
        start = time.perf_counter()
        yield
        self.stages[stage] += time.perf_counter() - start


def render(bench: Memory) -> list[Frame]:
    """The whole plan, on one worker."""
    notes: dict[str, dict[str, Note]] = {}
    for step in Analogy.steps:
        bench.step, notes[step.name] = step.name, {}
        for task in step.plan(Brief(bench.params, 0, bench.video, frozenset(bench.inputs), notes)):
            notes[step.name][task.key] = step.run(task, bench)
    return [bench.painted[index] for index in sorted(bench.painted)]


def painting(side_px: int = 800) -> Frame:
    """A style with texture at every scale, px on its long side."""
    from pipeline.methods.analogy.exemplar import own_pair

    own = own_pair()[1]
    scale = side_px / max(own.shape[:2])
    return np.asarray(cv2.resize(own, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC), np.uint8)


def measure(size: tuple[int, int], **params: Any) -> dict[str, Any]:
    """One row: seconds a frame, wall and CPU, and the wall seconds of each stage."""
    bench = Memory(AnalogyParams(**params), {"video": clip(size, FRAMES), "style_output": [painting()]})
    wall, cpu = time.perf_counter(), time.process_time()
    render(bench)
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    stages = {name: seconds / FRAMES for name, seconds in bench.stages.items()}
    return {"size": size, "wall": wall / FRAMES, "cpu": cpu / FRAMES, "stages": stages}


def still(side: tuple[int, int] = (810, 1000)) -> tuple[float, float | None]:
    """Seconds for a still of EbSynth's size by us, and by EbSynth where it is on the PATH."""
    plain = scene("portrait", side, frames=1).image(0)
    picture = scene("shapes", side, frames=1).image(0)
    painted = painting(max(side))
    start = time.perf_counter()
    render(Memory(AnalogyParams(tone_match="on"), {"video": [picture], "style_output": [painted]}))
    ours = time.perf_counter() - start
    return ours, _ebsynth(painted, plain, picture)


def _ebsynth(painted: Frame, plain: Frame, picture: Frame) -> float | None:
    program = shutil.which("ebsynth")
    if program is None:
        return None
    with tempfile.TemporaryDirectory() as folder:
        files = {name: str(Path(folder) / f"{name}.png") for name in ("style", "source", "target", "out")}
        height, width = painted.shape[:2]
        source = cv2.resize(plain, (width, height))
        for name, image in (("style", painted), ("source", source), ("target", picture)):
            cv2.imwrite(files[name], cv2.cvtColor(np.asarray(image, np.uint8), cv2.COLOR_RGB2BGR))
        guide = ["-guide", files["source"], files["target"]]
        start = time.perf_counter()
        ends = ["-output", files["out"], "-backend", "cpu"]
        subprocess.run([program, "-style", files["style"], *guide, *ends], check=True)
        return time.perf_counter() - start


def main() -> None:
    """Print the tables."""
    measure((320, 240))
    for params in ({}, {"rotation": "on"}):
        print(f"{'size':>10} {'s/frame':>8} {'CPU s':>7} {'us/px':>6}   wall s a frame by stage  {params or ''}")
        for size in SIZES:
            row = measure(size, **params)
            stages = "  ".join(f"{name} {seconds:.2f}" for name, seconds in row["stages"].items())
            per_px = row["cpu"] / (size[0] * size[1]) * 1e6
            print(f"{size[0]}x{size[1]:<5} {row['wall']:8.2f} {row['cpu']:7.2f} {per_px:6.2f}   {stages}")
    ours, theirs = still()
    beside = f"EbSynth {theirs:.1f} s, {theirs / ours:.1f} times ours" if theirs else "EbSynth is not on the PATH"
    print(f"still of 810x1000: {ours:.2f} s; {beside}")


if __name__ == "__main__":
    main()
