"""Time per frame of the analogy method by size and stage, at the paper's settings: 9x9 patches, four levels, one pair
of sweeps. Then compares its stills with EbSynth's CPU build, if it is installed.
"""

from __future__ import annotations

import time
from typing import Any

import cv2
import numpy as np

from benchmarks import analogy_stills
from benchmarks.analogy_renders import Memory, render
from benchmarks.clips import clip
from pipeline.frames import Frame
from pipeline.methods.analogy import AnalogyParams
from pipeline.methods.analogy.style_images import paint_in_strokes
from pipeline.scenes import scene

SIZES = ((640, 480), (1280, 720), (1920, 1080))
FRAMES = 3


def painting(side_px: int = 800) -> Frame:
    """A style image with texture at every scale; its longer side has `side_px` px."""
    own = paint_in_strokes(scene("portrait", (480, 320), frames=1).image(0))
    scale = side_px / max(own.shape[:2])
    return np.asarray(cv2.resize(own, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC), np.uint8)


def measure(size: tuple[int, int], **params: Any) -> dict[str, Any]:
    """Wall and CPU seconds per frame, and wall seconds of each stage."""
    context = Memory(AnalogyParams(**params), {"video": clip(size, FRAMES), "style_output": [painting()]})
    wall, cpu = time.perf_counter(), time.process_time()
    render(context)
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    stages = {name: seconds / FRAMES for name, seconds in context.stages.items()}
    return {"size": size, "wall": wall / FRAMES, "cpu": cpu / FRAMES, "stages": stages}


def main() -> None:
    """Print the tables."""
    measure((320, 240))
    for params, sizes in (({}, SIZES), ({"rotation": "on"}, SIZES[:1])):
        print(f"{'size':>10} {'s/frame':>8} {'CPU s':>7} {'us/px':>6}   wall s a frame by stage  {params or ''}")
        for size in sizes:
            row = measure(size, **params)
            stages = "  ".join(f"{name} {seconds:.2f}" for name, seconds in row["stages"].items())
            per_px = row["cpu"] / (size[0] * size[1]) * 1e6
            print(f"{size[0]}x{size[1]:<5} {row['wall']:8.2f} {row['cpu']:7.2f} {per_px:6.2f}   {stages}")
    analogy_stills.main()


if __name__ == "__main__":
    main()
