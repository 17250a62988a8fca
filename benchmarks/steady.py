"""Flicker, detail and CPU time of `steady` on frames that other tools stylised one by one.

    python -m benchmarks.steady                                four clips, every painter that this machine has
    python -m benchmarks.steady --frames 16 --painters stylization oil --param detail=1
    python -m benchmarks.steady --ebsynth ~/ebsynth/bin/ebsynth --keep /tmp/styled

The columns are relative to the styled frames, so that 1 means equal:

    flicker      root of the warping error along the source's motion (lai2018learning): less is steadier
    detail       mean gradient of the lightness
    laplacian    mean absolute Laplacian of the lightness
    difference   mean absolute difference of the two Laplacians; 0 = every frame has the styled frame's own texture

The rows `median` show the same figures for a minimal filter: the median of each styled frame and its two neighbours,
which are warped along the motion. CPU time is that of this process, without decoding and encoding.
"""

from __future__ import annotations

import argparse
import itertools
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.clips import MEDIA, fit, read_picture
from pipeline.frames import Frame
from pipeline.methods.local import LocalContext, run_plan
from pipeline.methods.steady import Steady, SteadyFilter, SteadyParams
from pipeline.perception.flow.dis import dis
from pipeline.perception.flow.gray import to_gray
from pipeline.perception.flow.warp import warp_back
from pipeline.quality.coherence import detail, flicker, measure_pair
from pipeline.video.reader import VideoReader

CLIPS = {
    "dog": "dog_720p_audio.mp4", "juggle": "juggle_720p.mp4", "marathon": "marathon_720x400.mp4",
    "seattle": "seattle_pan_640x360.avi",
}  # fmt: skip
SIZE = (640, 360)
GMIC_FILTER = ("-fx_painting", "5,2.5,1.5,50,1,0", "-c", "0,255")
EBSYNTH_OPTIONS = ("-searchvoteiters", "3", "-patchmatchiters", "3", "-pyramidlevels", "4")

Painter = Callable[[Frame], Frame]


@dataclass(frozen=True)
class Row:
    """Figures of one video relative to the styled frames."""

    flicker: float
    detail: float
    laplacian: float
    difference: float


def compare(source: Sequence[Frame], styled: Sequence[Frame], result: Sequence[Frame]) -> Row:
    """Measure `result`. All three videos have the same number of frames and the same size."""
    errors = [0.0, 0.0]
    for before, now in itertools.pairwise(range(len(source))):
        pair = source[before], source[now]
        for each, frames in enumerate((styled, result)):
            errors[each] += measure_pair(pair, (frames[before], frames[now])).painted_error
    ours, theirs = [laplacian(frame) for frame in result], [laplacian(frame) for frame in styled]
    amount = sum(float(np.abs(plane).mean()) for plane in theirs)
    return Row(
        flicker(errors[1], errors[0]),
        sum(detail(frame) for frame in result) / sum(detail(frame) for frame in styled),
        sum(float(np.abs(plane).mean()) for plane in ours) / amount,
        sum(float(np.abs(one - other).mean()) for one, other in zip(ours, theirs, strict=True)) / amount,
    )


def laplacian(frame: Frame) -> NDArray[np.float32]:
    """Laplacian of the lightness, gray levels."""
    gray = cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY).astype(np.float32)
    return np.asarray(cv2.Laplacian(gray, cv2.CV_32F), np.float32)


def median_of_three(source: Sequence[Frame], styled: Sequence[Frame]) -> list[Frame]:
    """Median of each styled frame and its neighbours, these moved along the motion of the source."""
    gray = [to_gray(frame) for frame in source]
    made = [styled[0]]
    for now in range(1, len(source) - 1):
        around = [warp_back(styled[other], dis(gray[now], gray[other], "medium")) for other in (now - 1, now + 1)]
        made.append(np.median([*around, styled[now]], axis=0).astype(np.uint8))
    return [*made, styled[-1]]


def stylization(frame: Frame) -> Frame:
    return np.ascontiguousarray(cv2.stylization(np.ascontiguousarray(frame[..., ::-1]))[..., ::-1])


def oil(frame: Frame) -> Frame:
    return np.ascontiguousarray(cv2.xphoto.oilPainting(np.ascontiguousarray(frame[..., ::-1]), 4, 1)[..., ::-1])


def gmic(frame: Frame) -> Frame:
    """G'MIC's filter "Painting"."""
    with tempfile.TemporaryDirectory() as folder:
        given, made = Path(folder) / "given.png", Path(folder) / "made.png"
        cv2.imwrite(str(given), frame[..., ::-1])
        subprocess.run(["gmic", "-v", "0", given, *GMIC_FILTER, "-o", made], check=True, timeout=600)
        return read_picture(made)


def ebsynth(program: str, first: Frame) -> Painter:
    """EbSynth with one keyframe, the oil painting of a clip's first frame; the frames themselves are the guides."""

    def paint(frame: Frame) -> Frame:
        with tempfile.TemporaryDirectory() as folder:
            paths = {name: Path(folder) / f"{name}.png" for name in ("key", "first", "frame", "made")}
            for name, picture in (("key", oil(first)), ("first", first), ("frame", frame)):
                cv2.imwrite(str(paths[name]), picture[..., ::-1])
            subprocess.run(
                [program, "-style", paths["key"], "-guide", paths["first"], paths["frame"], "-weight", "2",
                 "-output", paths["made"], *EBSYNTH_OPTIONS], check=True, timeout=3600, stdout=subprocess.DEVNULL,
            )  # fmt: skip
            return read_picture(paths["made"])

    return paint


def painters(names: Sequence[str], ebsynth_program: str | None) -> Mapping[str, Callable[[Frame], Painter]]:
    """Painters by name, created for a clip from its first frame. Painters whose program is missing are reported."""
    found: dict[str, Callable[[Frame], Painter]] = {
        "stylization": lambda first: stylization, "oil": lambda first: oil,
    }  # fmt: skip
    if shutil.which("gmic"):
        found["gmic"] = lambda first: gmic
    if ebsynth_program:
        found["ebsynth"] = lambda first: ebsynth(ebsynth_program, first)
    for missing in {"gmic", "ebsynth"} - found.keys():
        print(f"{missing}: not on this machine, left out", file=sys.stderr)
    return {name: make for name, make in found.items() if not names or name in names}


def frames_of(name: str, count: int) -> list[Frame]:
    """The first frames of a clip at 640x360."""
    with VideoReader(MEDIA / CLIPS[name]) as reader:
        return [fit(frame, SIZE) for frame in itertools.islice(reader.read(), count)]


def styled_frames(source: Sequence[Frame], paint: Painter, kept: Path | None) -> list[Frame]:
    """Paint each frame independently. `kept`: a file from which the frames are read, or to which they are written."""
    if kept is not None and kept.is_file():
        found = np.load(kept)
        if len(found) >= len(source):
            return [np.ascontiguousarray(frame) for frame in found[: len(source)]]
    made = [paint(frame) for frame in source]
    if kept is not None:
        kept.parent.mkdir(parents=True, exist_ok=True)
        np.save(kept, np.stack(made))
    return made


def steadied(source: Sequence[Frame], styled: Sequence[Frame], params: SteadyParams) -> list[Frame]:
    """The result of a job with the method `steady`."""
    context = LocalContext(params, list(source), {"styled": list(styled)})
    run_plan(Steady(), context)
    return [context.emitted[index] for index in range(len(source))]


def cpu_ms(source: Sequence[Frame], styled: Sequence[Frame], params: SteadyParams) -> tuple[float, float]:
    """Median CPU time of the two halves of a step on one thread, ms: analysis of the source, and the rest."""
    behind = SteadyFilter(params, SIZE)
    halves: tuple[list[float], list[float]] = [], []
    for frame, painted in zip(source, styled, strict=True):
        began = time.thread_time()
        analysis = behind.analyze(frame)
        between = time.thread_time()
        behind.apply(analysis, painted)
        halves[0].append(between - began)
        halves[1].append(time.thread_time() - between)
    first, second = (1e3 * float(np.median(half[1:])) for half in halves)
    return first, second


def rows(options: argparse.Namespace, params: SteadyParams) -> Iterator[str]:
    """Measure each clip and painter; yields a row as soon as it is measured."""
    chosen = painters(options.painters, options.ebsynth)
    for name in options.clips:
        source = frames_of(name, options.frames)
        for painter, make in chosen.items():
            kept = options.keep / f"{name}-{painter}.npy" if options.keep else None
            styled = styled_frames(source, make(source[0]), kept)
            found = compare(source, styled, steadied(source, styled, params))
            motion, rest = cpu_ms(source, styled, params)
            yield _line(name, painter, found, f"{motion:.0f} + {rest:.0f}")
            if options.median:
                yield _line(name, f"{painter}, median", compare(source, styled, median_of_three(source, styled)), "")


def _line(clip: str, painter: str, row: Row, cost: str) -> str:
    figures = f"{row.flicker:.2f} | {row.detail:.2f} | {row.laplacian:.2f} | {row.difference:.2f}"
    return f"| {clip} | {painter} | {figures} | {cost} |"


def main(arguments: Sequence[str] = ()) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=40)
    parser.add_argument("--clips", nargs="+", choices=CLIPS, default=list(CLIPS))
    parser.add_argument("--painters", nargs="+", default=[], help="stylization, oil, gmic, ebsynth; all if omitted")
    parser.add_argument("--ebsynth", metavar="PROGRAM", help="EbSynth's command line program")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="keeps the styled frames for the next run")
    parser.add_argument("--median", action="store_true", help="also measure the median of three frames")
    parser.add_argument("--param", nargs="*", default=[], metavar="NAME=VALUE", help="parameters of steady")
    options = parser.parse_args(arguments)
    params = SteadyParams.model_validate(dict(given.split("=", 1) for given in options.param))
    print("| clip | frames made by | flicker | detail | laplacian | difference | CPU ms a frame, motion + rest |")
    print("|---|---|---|---|---|---|---|")
    for line in rows(options, params):
        print(line, flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
