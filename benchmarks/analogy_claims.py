"""Measurements of the analogy method: flicker, trails, variety, transitions at keyframes, two workers.

`python -m benchmarks.analogy_claims [NAME ...]`. Independent tools in a `shared` folder beside the project measure
flicker and similarity to the style; without that folder those columns are omitted.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks.analogy_renders import Memory, render, some
from benchmarks.clips import MEDIA
from pipeline.frames import Frame, Plane
from pipeline.methods.analogy import AnalogyParams
from pipeline.methods.analogy.style_images import paint_in_strokes
from pipeline.scenes import scene
from pipeline.scenes.shot import shot_files
from pipeline.video.reader import VideoReader

TOOLS = Path(__file__).resolve().parents[2] / "shared" / "tools"
COUNT = 8
SIZE = (480, 270)


def painting(name: str) -> Frame:
    """A painting of the media folder, or a synthetic one if the folder is missing."""
    path = MEDIA.parent / "style" / "paintings" / f"{name}.jpg"
    if not path.is_file():
        return paint_in_strokes(scene("portrait", (480, 320), frames=1).image(0))
    with VideoReader(path) as reader:
        return next(reader.read(0, 1))


def film(name: str, height: int, start: int = 10) -> list[Frame]:
    """Frames of a clip of the media folder, scaled to a height."""
    with VideoReader(MEDIA / name) as reader:
        found = list(reader.read(start, start + COUNT))
    size = (round(found[0].shape[1] * height / found[0].shape[0]), height)
    return [np.asarray(cv2.resize(frame, size, interpolation=cv2.INTER_AREA), np.uint8) for frame in found]


def shot(name: str, size: tuple[int, int] = SIZE, count: int = COUNT) -> tuple[list[Frame], Mapping[str, bytes]]:
    """The frames of a procedural scene, and its files with exact motion vectors, without layers."""
    made = scene(name, size, frames=count)
    files = dict(shot_files(made))
    del files["shot.json"]
    return [made.image(index) for index in range(count)], files


def painted(
    frames: Sequence[Frame], style: Frame, files: Mapping[str, bytes] | None = None, **params: Any
) -> list[Frame]:
    context = Memory(AnalogyParams(**params), {"video": list(frames), "style_output": [style]}, files)
    return render(context)


# -- measurements by independent tools


def saved(folder: Path, frames: Sequence[Frame]) -> Path:
    """Write frames as numbered PNG files into a new folder; returns the folder."""
    folder.mkdir(parents=True)
    for index, frame in enumerate(frames):
        cv2.imwrite(str(folder / f"{index:04d}.png"), cv2.cvtColor(frame, cv2.COLOR_RGB2BGR))
    return folder


def asked(tool: str, *paths: Path) -> list[Mapping[str, float]]:
    """The measurements of a tool, one for each path after the first; empty without the tool."""
    if not (TOOLS / tool).is_file():
        return [{} for _ in paths[1:]]
    done = subprocess.run([sys.executable, TOOLS / tool, *paths, "--json"], check=True, capture_output=True)
    found: list[Mapping[str, float]] = json.loads(done.stdout)
    return found


def compare(source: Sequence[Frame], style: Frame, outputs: Mapping[str, Sequence[Frame]]) -> None:
    """Print a row for each output."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        plain = saved(folder / "source", source)
        made = [saved(folder / name, frames) for name, frames in outputs.items()]
        saved(folder / "style", [style])
        steady = asked("coherence.py", plain, *made)
        alike = asked("style_fidelity.py", folder / "style" / "0000.png", *(m / "0004.png" for m in made))
    for name, one, other in zip(outputs, steady, alike, strict=True):
        keys = ("flicker", "structure", "detail"), ("fidelity", "variety", "palette_max")
        cells = [f"{key} {row[key]:.3g}" for part, row in zip(keys, (one, other), strict=True) for key in part if row]
        print(f"  {name:>12}  " + "  ".join(cells), flush=True)


# -- claims


def clip() -> None:
    """Live-action clips, with a painting as the only guidance."""
    for name, height, style in CLIPS:
        print(f"  {name}, {height} lines, {style}")
        source, exemplar = film(name, height), painting(style)
        compare(source, exemplar, {how: painted(source, exemplar, temporal=how) for how in ("on", "off")})


CLIPS = (
    ("coffee_720p_audio.mp4", 270, "the_scream"),
    ("coffee_720p_audio.mp4", 270, "delaunay_1906"),
    ("asl_walk_640x480.mkv", 300, "delaunay_1906"),
    ("face_portrait_768x1024.mp4", 384, "delaunay_1906"),
)


def stage() -> None:
    """A procedural scene with exact velocities."""
    (source, files), style = shot("harbour"), painting("the_scream")
    compare(source, style, {name: painted(source, style, files, temporal=name) for name in ("on", "off")})


def trails() -> None:
    """Lightness error of background that was disoccluded in this frame, relative to the error elsewhere."""
    (source, files), style = shot("shapes"), painting("delaunay_1906")
    made = scene("shapes", SIZE, frames=COUNT)
    for name in ("on", "off"):
        out = painted(source, style, files, occlusion=name, **TRAILING)
        print(f"  occlusion {name:>3}: {trail(made, source, out):.2f}", flush=True)


TRAILING = {"steadiness": 20, "guide_weight": 2, "tone_match": "off"}
"""High steadiness, so that wrongly propagated pixels remain visible."""


def trail(made: Any, source: Sequence[Frame], out: Sequence[Frame]) -> float:
    """Ratio of the mean lightness error of pixels that were occluded one frame ago to that of all other pixels."""
    fresh, rest = [], []
    for index in range(1, len(out)):
        new = made.frame(index).occluded_previous.copy()
        new[:, :12] = new[:, -12:] = False
        new[:12] = new[-12:] = False
        wrong = np.abs(_soft(out[index]) - _soft(source[index]))
        fresh.append(wrong[new])
        rest.append(wrong[~new])
    return float(np.concatenate(fresh).mean() / np.concatenate(rest).mean())


def _soft(frame: Frame) -> Plane:
    gray = np.asarray(cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY), np.float32)
    return np.asarray(cv2.GaussianBlur(gray, (0, 0), 2), np.float32)


def variety() -> None:
    """Variety of the style pixels used, with and without the histogram term."""
    source, style = film("coffee_720p_audio.mp4", 270)[:1] * 5, painting("water_lilies")
    found = {f"h_s {w}": painted(source[:1], style, variety_weight=w) * 5 for w in (0, 200, 1000)}
    compare(source, style, found)


def keys() -> None:
    """Two keys with a change of light between them: mean difference of neighbouring frames, at keys and elsewhere."""
    source, images = shaded_keys()
    context = Memory(AnalogyParams(), {"video": source}, numbered={"keyframes": images})
    out = np.stack(render(context)).astype(int)
    steps = np.abs(np.diff(out, axis=0)).mean((1, 2, 3))
    at = [k for k in range(len(steps)) if k in images or k + 1 in images]
    others = [k for k in range(len(steps)) if k not in at]
    exact = all((out[k] == image).all() for k, image in images.items())
    print(f"  keys exact: {exact}; steps of frames, gray levels: {' '.join(f'{s:.1f}' for s in steps)}")
    print(f"  at a key {steps[at].max():.2f} at most, elsewhere {steps[others].max():.2f} at most", flush=True)


def shaded_keys() -> tuple[list[Frame], dict[int, Frame]]:
    """Eleven frames of the portrait scene that darken by a third; the first and last are painted in short strokes."""
    from pipeline.methods.multistyle import MultistyleParams, MultistyleSession

    made = scene("portrait", (320, 240), frames=11)
    source = [np.asarray(np.rint(made.image(k) * (1 - 0.035 * k)), np.uint8) for k in range(11)]
    first = MultistyleSession(MultistyleParams(style="impressionism"), (320, 240))
    last = MultistyleSession(MultistyleParams(style="impressionism"), (320, 240))
    return source, {0: first.step(source[0]), 10: last.step(source[10])}


def workers() -> None:
    """CPU seconds of the busiest worker for two intervals between keys: one worker against two, one processor each."""
    with ProcessPoolExecutor(2, get_context("spawn"), initializer=_one_processor) as pool:
        list(pool.map(_interval, ((0,), (1,))))  # both have compiled now
        one, whole = pool.submit(_interval, (0, 1)).result()
        parts = list(pool.map(_interval, ((0,), (1,))))
    busiest, joined = max(seconds for seconds, _ in parts), parts[0][1] | parts[1][1]
    same = all((joined[index] == frame).all() for index, frame in whole.items()) and joined.keys() == whole.keys()
    print(f"  one {one:.1f} s, the busier of two {busiest:.1f} s: {one / busiest:.2f} times; same bytes: {same}")


def _one_processor() -> None:
    os.environ["POCL_MAX_PTHREAD_COUNT"] = os.environ["POCL_CPU_MAX_CU_COUNT"] = "1"
    cv2.setNumThreads(1)


def _interval(which: Sequence[int]) -> tuple[float, dict[int, Frame]]:
    """Run some of the tasks between three keys; the CPU seconds that they took, and their frames."""
    source, images = shaded_keys()
    given = {0: images[0], 5: _own_key(source[5]), 10: images[10]}
    context = Memory(AnalogyParams(), {"video": source}, numbered={"keyframes": given})
    start = time.process_time()
    some(context, which)
    return time.process_time() - start, context.painted


def _own_key(plain: Frame) -> Frame:
    from pipeline.methods.multistyle import MultistyleParams, MultistyleSession

    return MultistyleSession(MultistyleParams(style="impressionism"), (plain.shape[1], plain.shape[0])).step(plain)


CLAIMS: Mapping[str, Callable[[], None]] = {
    "clip": clip, "scene": stage, "trails": trails, "variety": variety, "keys": keys, "workers": workers,
}  # fmt: skip


def main() -> None:
    for name in sys.argv[1:] or CLAIMS:
        print(f"{name}: {CLAIMS[name].__doc__}")
        CLAIMS[name]()


if __name__ == "__main__":
    main()
