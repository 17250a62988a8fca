"""Ablation of the corrections of abstraction and multistyle: measures of a film with each of them and without it.

A correction is switched off from outside, by replacing functions or constants of its module (`CORRECTIONS`). All
variants of a clip are rendered in one process, one after the other, from the same decoded frames. `python -m
benchmarks.ablation METHOD RESULTS.csv [--pictures FOLDER] [--only NAME ...]` appends one row for each clip and
correction; `table` draws the means of such a file. The measures are those of the tools beside the media folder.
"""

from __future__ import annotations

import argparse
import csv
import importlib
import importlib.util
import statistics
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from types import ModuleType
from typing import Any
from unittest.mock import patch

import cv2
import numpy as np

from benchmarks.clips import MEDIA, fit, read_picture
from pipeline.frames import Frame
from pipeline.methods.abstraction import AbstractionParams, AbstractionSession
from pipeline.methods.multistyle import MultistyleParams, MultistyleSession
from pipeline.video.reader import VideoReader
from workers.execution.renderer import prepare_process

TOOLS = MEDIA.parents[1] / "tools"
FACES_EVERY, STILLS = 4, (5, 11)
"""Frames between two that are searched for faces; frames whose edges and flat share are measured."""
MEASURES = ("flicker", "detail", "structure", "faces", "eyes", "edge_px", "flat", "cpu_ms")


@dataclass(frozen=True)
class Film:
    """Some frames of a clip: first frame, number of frames, and their (width, height)."""

    path: str
    first: int
    size: tuple[int, int]
    frames: int = 12

    @property
    def name(self) -> str:
        return self.path.split("/")[-1].split(".")[0]

    def read(self) -> list[Frame]:
        path = MEDIA.parent / self.path
        if path.is_dir():
            files = sorted((path / "frames").iterdir())[self.first : self.first + self.frames]
            return [fit(read_picture(file), self.size) for file in files]
        with VideoReader(path) as reader:
            return [fit(frame, self.size) for frame in reader.read(self.first, self.first + self.frames)]


FILMS = (
    Film("video/face_portrait_768x1024.mp4", 10, (480, 640)),
    Film("davis/dance-twirl", 0, (854, 480), 20),
    Film("video/coffee_720p_audio.mp4", 60, (854, 480)),
    Film("video/asl_walk_640x480.mkv", 0, (640, 480)),
    Film("video/street_pan_1080p.mp4", 0, (1280, 720)),
    Film("video/foreman_cif.mp4", 0, (352, 288)),
    Film("video/marathon_720x400.mp4", 20, (720, 400)),
    Film("video/juggle_720p.mp4", 30, (854, 480)),
    Film("video/bunny_30s_720p.webm", 300, (854, 480)),
    Film("video/dog_720p_audio.mp4", 0, (854, 480)),
    Film("video/head_turn.gif", 0, (480, 270)),
    Film("davis/bmx-trees", 10, (854, 480)),
    Film("video/carphone_qcif.mp4", 0, (176, 144)),
    Film("video/chaplin_bw_audio.mp4", 0, (640, 360)),
    Film("video/seattle_pan_640x360.avi", 0, (640, 360)),
    Film("davis/blackswan", 0, (854, 480)),
)


@dataclass(frozen=True)
class Correction:
    """A correction, and the replacements that switch it off: "module:name" or "module:class.name", below `pipeline`."""

    name: str
    off: dict[str, Any]


def _first(value: Any, *_: Any, **__: Any) -> Any:
    return value


def _none(*_: Any, **__: Any) -> None:
    return None


def _no_stripes(points: Any, curves: Any, *_: Any) -> Any:
    return np.zeros(len(curves.order), np.float32)


def _no_texture(points: Any, curves: Any, shape: tuple[int, int], side: int) -> Any:
    return np.zeros((shape[0] // side + 1, shape[1] // side + 1), np.float32)


def _choose_by_all_points(
    points: Any, curves: Any, past: Any, texture: Any, side: int, strong: float, least: float, drawn: Any
) -> None:  # fmt: skip
    """`lines.selection._choose`, where a point weaker than the texture around takes ink away."""
    from pipeline.lines.selection import SELECTION, _was_drawn

    for k in range(drawn.size):
        own = points[curves.order[curves.starts[k] : curves.starts[k + 1]]]
        excess = own["response"] - own["threshold"]
        unimportant = 1 - SELECTION.importance_share * np.minimum(own["importance"], 1)
        around = texture[own["y"].astype(int) // side, own["x"].astype(int) // side]
        ink = float((excess - SELECTION.texture * unimportant * around).sum())
        known = 4 * sum(_was_drawn(point, past) for point in own) > len(own)
        share = SELECTION.known_share if known else 1.0
        drawn[k] = (known or excess.max() > strong) and ink >= least * unimportant.min() * share


def _no_edges_of_faces(planes: Any, importance: Any, threshold: float, faces: Any) -> Any:
    from pipeline.regions.edges import edges

    return edges(planes, importance, threshold)


def _plain_rest(flow: Any, before: Any, gray: Any, tolerance: float) -> Any:
    from pipeline.perception.motion import zero_still_flow

    return zero_still_flow(flow, before, gray, tolerance)


def _all_edges_stay(now: Any, before: Any, flow: Any, memory: float, _: float) -> Any:
    from pipeline.perception.flow.warp import warp_back

    return now + np.float32(memory) * (np.stack([warp_back(plane, flow) for plane in before]) - now)


def _small_window(difference: Any) -> Any:
    from pipeline.strokes import accumulation

    side = max(3, round(accumulation.ACCUMULATION.small * min(difference.shape[:2]))) | 1
    return accumulation._mean_change(difference, side)


def _untorn_change(picture: Any, before: Any, flow: Any) -> Any:
    from pipeline.strokes import accumulation

    height, width = picture.shape[:2]
    difference = np.empty((max(1, height // 2), max(1, width // 2), 3), np.float32)
    accumulation._mean_difference(picture, before, flow, difference, np.empty(difference.shape[:2], np.float32))
    return accumulation._largest_change(difference)


ABSTRACTION, MULTISTYLE = "methods.abstraction", "methods.multistyle"
SHARED = (
    Correction(
        "face_search_order",
        {
            "perception.faces:FaceTracker._search_new": _none,
            "perception.faces:NewPlaces.move": _none,
            "perception.faces:NewPlaces.newness": lambda *_: 0.0,
        },
    ),
    Correction(
        "second_cascade",
        {
            "perception.face_detector:FaceDetector.agrees": lambda *_: True,
            "perception.faces:DETECTION.profile_hits": 2,
        },
    ),
    Correction(
        "profiles_and_tilted_faces",
        {"perception.faces:POSES": ("frontal",), "perception.face_detector:POSES": ("frontal",)},
    ),
)
CORRECTIONS = {
    "abstraction": (
        *SHARED,
        Correction("face_contrast", {f"{ABSTRACTION}.analysis:raise_contrast": _none}),
        Correction("small_faces_sharpened", {f"{ABSTRACTION}.analysis:FrameAnalyzer._sharpen": _none}),
        Correction("edges_in_small_faces", {f"{ABSTRACTION}.analysis:edges": _no_edges_of_faces}),
        Correction(
            "face_lines", {f"{ABSTRACTION}.line_extractor:LineExtractor._finer": lambda _, response, *__: response}
        ),
        Correction("face_feature_gain", {f"{ABSTRACTION}.line_extractor:_feature_gain": lambda *_: np.float32(1)}),
        Correction("texture_left_out", {"lines.selection:_texture": _no_texture}),
        Correction("weak_points_count_nothing", {"lines.selection:_choose": _choose_by_all_points}),
        Correction(
            "spots_are_no_lines",
            {"lines.selection:_lengths": lambda _, curves, __: np.full(len(curves.starts) - 1, np.inf)},
        ),
        Correction("lines_fade_out", {f"{ABSTRACTION}.line_extractor:join_strokes": lambda _, strokes: strokes}),
        Correction("ramps", {f"{ABSTRACTION}.border_curves:divide_ramps": _first}),
        Correction("coloured_stripes", {f"{ABSTRACTION}.line_extractor:stripe_shares": _no_stripes}),
        Correction("lines_on_edges", {"lines.inking:_shift_to_edges": _none}),
        Correction("fair_lines", {"lines.inking:fair": _first}),
        Correction("borders_under_lines", {f"{ABSTRACTION}.border_curves:hide_borders_under_lines": _first}),
        Correction("simplified_borders", {f"{ABSTRACTION}.border_curves:simplify_borders": _first}),
        Correction("still_pixels", {f"{ABSTRACTION}.analysis:zero_still_flow": _first}),
        Correction("shot_contrast", {f"{ABSTRACTION}.analysis:FrameAnalyzer._contrast": lambda *_: 1.0}),
        Correction("line_response_blended", {f"{ABSTRACTION}.line_extractor:blend_response": _first}),
        Correction("strokes_follow_the_past", {f"{ABSTRACTION}.line_extractor:follow_marks": _first}),
        Correction("released_changed_pixels", {"regions.segmenter:CHANGED": 255.0}),
        Correction("distinct_small_regions", {f"{ABSTRACTION}.region_stage:REGIONS.distinct": 1e9}),
    ),
    "multistyle": (
        *SHARED[:1],
        Correction("face_contrast", {f"{MULTISTYLE}.analyzer:raise_contrast": _none}),
        Correction("face_layer", {f"{MULTISTYLE}.analyzer:StrokeAnalyzer._on_faces": lambda *_: ()}),
        Correction("attention", {f"{MULTISTYLE}.analyzer:StrokeAnalyzer._attention": lambda *_: (None, None)}),
        Correction("large_faces", {f"{MULTISTYLE}.analyzer:ANALYZER.large_faces": 1.0}),
        Correction("resting_flat_areas", {f"{MULTISTYLE}.backward_flow:zero_still_flow_by_texture": _plain_rest}),
        Correction(
            "torn_flow",
            {
                f"{MULTISTYLE}.denoise:_raise_where_torn": _none,
                "strokes.accumulation:_surface_change": _untorn_change,
            },
        ),
        Correction("noise_raises_tolerance", {f"{MULTISTYLE}.denoise:DENOISE.noisy": 1.0}),
        Correction("large_window_of_change", {"strokes.accumulation:_largest_change": _small_window}),
        Correction("texture_share", {f"{MULTISTYLE}.denoise:DENOISE.texture_share": 0.0}),
        Correction("denoised_directions", {f"{MULTISTYLE}.analyzer:denoise_directions": _first}),
        Correction("borders_that_leave", {f"{MULTISTYLE}.analyzer:smooth_over_time": _all_edges_stay}),
        Correction("broad_directions", {f"{MULTISTYLE}.analyzer:ANALYZER.broad_weight": 0.0}),
        Correction(
            "detail_dead_band",
            {
                f"{MULTISTYLE}.analyzer:ANALYZER.detail_dead_band": 0.0,
                f"{MULTISTYLE}.analyzer:ANALYZER.detail_gain": 1.0,
            },
        ),
        Correction("error_memory", {f"{MULTISTYLE}.stroke_layers:LAYERS.error_memory": 0.0}),
        Correction("error_hysteresis", {f"{MULTISTYLE}.stroke_layers:LAYERS.keep": 1.0}),
        Correction("strict_edges_of_detail", {f"{MULTISTYLE}.stroke_layers:LAYERS.edge_detail_fall": 0.0}),
        Correction("strict_edges_of_faces", {f"{MULTISTYLE}.stroke_layers:LAYERS.edge_face_fall": 0.0}),
        Correction("rounded_relief", {f"{MULTISTYLE}.painter:_round_off": _none}),
        Correction("limited_ground", {f"{MULTISTYLE}.painter:PAINTER.cover_limit": 1e9}),
    ),
}


@contextmanager
def without(correction: Correction | None) -> Iterator[None]:
    """Switch a correction off for a while; None = everything stays on."""
    with ExitStack() as stack:
        for target, replacement in (correction.off if correction else {}).items():
            module, _, path = target.partition(":")
            *owners, name = path.split(".")
            owner: Any = importlib.import_module(f"pipeline.{module}")
            if owners and owners[0].isupper():  # a field of the constants of a subject
                replacement = _changed(getattr(owner, owners[0]), name, replacement)
                name = owners[0]
            elif owners:
                owner = getattr(owner, owners[0])
            stack.enter_context(patch.object(owner, name, replacement))
        yield


def _changed(constants: Any, name: str, value: Any) -> Any:
    """Constants with another value of one field."""
    changed = getattr(constants, "_replace", partial(replace, constants))  # a named tuple or a dataclass
    return changed(**{name: value})


def render(method: str, frames: Sequence[Frame]) -> tuple[list[Frame], float]:
    """The film in one thread, and its processor time, ms a frame without the first."""
    size = (frames[0].shape[1], frames[0].shape[0])
    sessions: dict[str, Callable[[], Any]] = {
        "abstraction": lambda: AbstractionSession(AbstractionParams(), size),
        "multistyle": lambda: MultistyleSession(MultistyleParams(), size),
    }
    session = sessions[method]()
    done = [session.step(frames[0]).copy()]
    start = time.thread_time()
    done += [session.step(frame).copy() for frame in frames[1:]]
    return done, (time.thread_time() - start) / (len(frames) - 1) * 1e3


def tool(name: str) -> ModuleType:
    """A measuring tool beside the media folder."""
    spec = importlib.util.spec_from_file_location(name, TOOLS / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class Scale:
    """The measures of films made from one source. What depends on the source alone is computed once."""

    def __init__(self, frames: Sequence[Frame]) -> None:
        self.coherence, self.faces, self.crispness, self.flatness = map(
            tool, ("coherence", "faces", "crispness", "flatness")
        )
        self.source = [_bgr(frame) for frame in frames]
        self.steps = list(self._steps())
        self.boxes = {k: self.faces.faces(self.source[k], 6) for k in range(0, len(frames), FACES_EVERY)}
        self.errors, self.slopes = self._warp_error(self.source), self._detail(self.source)
        self.edges = [self.coherence.coarse_edges(image).ravel() for image in self.source]

    def _steps(self) -> Iterator[tuple[Any, Any]]:
        """For each frame but the first: places of its pixels in the frame before, and those that count."""
        height, width = self.source[0].shape[:2]
        grid = np.stack(np.meshgrid(np.arange(width), np.arange(height)), -1).astype(np.float32)
        dis: Any = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
        grays = [cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) for image in self.source]
        for before, gray in pairwise(grays):
            back, forth = dis.calc(gray, before, None), dis.calc(before, gray, None)
            where = grid + back
            there = cv2.remap(forth, where[..., 0], where[..., 1], cv2.INTER_LINEAR)
            inside = (where >= 0).all(-1) & (where[..., 0] <= width - 1) & (where[..., 1] <= height - 1)
            yield where, self.coherence.visible(back, there) & inside

    def _warp_error(self, images: Sequence[Any]) -> float:
        total = pixels = 0.0
        for k, (where, mask) in enumerate(self.steps, 1):
            warped = cv2.remap(images[k - 1], where[..., 0], where[..., 1], cv2.INTER_LINEAR)
            error = ((images[k].astype(np.float32) - warped) / 255) ** 2
            total, pixels = total + float(error.sum(-1)[mask].sum()), pixels + int(mask.sum())
        return total / max(pixels, 1)

    def _detail(self, images: Sequence[Any]) -> float:
        grays = [cv2.cvtColor(image, cv2.COLOR_BGR2GRAY).astype(np.float32) for image in images]
        slopes = [np.hypot(cv2.Sobel(g, cv2.CV_32F, 1, 0), cv2.Sobel(g, cv2.CV_32F, 0, 1)).mean() for g in grays]
        return float(np.mean(slopes))

    def _faces(self, images: Sequence[Any]) -> tuple[tuple[int, int], tuple[int, int]]:
        """Faces of the source that are kept, and their number; the same for large faces with two eyes."""
        count = found = large = eyes = 0
        for k, boxes in self.boxes.items():
            there = self.faces.faces(images[k], 3) if len(boxes) else ()
            for box in boxes:
                count += 1
                found += any(self.faces.overlap(box, other) > 0.4 for other in there)
                if box[2] >= self.faces.LARGE_PX and self.faces.two_eyes(self.source[k], box):
                    large, eyes = large + 1, eyes + self.faces.two_eyes(images[k], box)
        return (found, count), (eyes, large)

    def measure(self, film: Sequence[Frame]) -> dict[str, float | str]:
        """All measures but the time; faces and eyes as "kept/number"."""
        images = [_bgr(frame) for frame in film]
        edges = [self.coherence.coarse_edges(image).ravel() for image in images]
        faces, eyes = self._faces(images)
        stills = [images[k] for k in STILLS if k < len(images)]
        return {
            "flicker": float(np.sqrt(self._warp_error(images) / max(self.errors, 1e-12))),
            "detail": self._detail(images) / self.slopes,
            "structure": float(np.mean([np.corrcoef(a, b)[0, 1] for a, b in zip(self.edges, edges, strict=True)])),
            "faces": "{}/{}".format(*faces),
            "eyes": "{}/{}".format(*eyes),
            "edge_px": float(np.mean([np.median(self.crispness.widths(image)) for image in stills])),
            "flat": float(np.mean([self.flatness.flat_share(image) for image in stills])),
        }


def _bgr(frame: Frame) -> Any:
    return cv2.cvtColor(frame, cv2.COLOR_RGB2BGR)


def run(
    method: str, path: Path, pictures: Path | None, only: Sequence[str] = (), clips: Sequence[str] = ()
) -> None:  # fmt: skip
    """Render all films with each correction switched off, and append a row for each to the file at `path`."""
    prepare_process()
    chosen = [None, *(each for each in CORRECTIONS[method] if not only or each.name in only)]
    for film in (each for each in FILMS if not clips or each.name in clips):
        frames = film.read()
        scale = Scale(frames)
        plain, _ = render(method, frames)
        known = scale.measure(plain)
        for correction in chosen:
            with without(correction):
                done, cpu_ms = render(method, frames)
            name = correction.name if correction else "all on"
            difference = float(np.mean([cv2.absdiff(a, b).mean() for a, b in zip(plain, done, strict=True)]))
            measures = scale.measure(done) if difference else known
            row = {"method": method, "clip": film.name, "without": name, "cpu_ms": cpu_ms, "difference": difference}
            row |= measures
            _append(path, row)
            if pictures is not None:
                _keep(pictures / film.name, name, plain, done)


def _append(path: Path, row: dict[str, Any]) -> None:
    new = not path.exists()
    with path.open("a", newline="") as file:
        writer = csv.DictWriter(file, ["method", "clip", "without", *MEASURES, "difference"], lineterminator="\n")
        if new:
            writer.writeheader()
        writer.writerow({key: f"{value:.5g}" if isinstance(value, float) else value for key, value in row.items()})


def _keep(folder: Path, name: str, plain: Sequence[Frame], done: Sequence[Frame]) -> None:
    """Store the frame that differs most, with and without the correction."""
    if not any(cv2.absdiff(a, b).any() for a, b in zip(plain, done, strict=True)):
        return
    k = int(np.argmax([cv2.absdiff(a, b).mean() for a, b in zip(plain, done, strict=True)]))
    folder.mkdir(parents=True, exist_ok=True)
    for kind, film in (("with", plain), ("without", done)):
        cv2.imwrite(str(folder / f"{name}.{kind}.png"), _bgr(film[k]))


def changes(rows: Iterable[dict[str, str]], name: str) -> dict[str, float]:
    """Change of each measure without a correction: per cent, mean over the clips; faces and eyes in points
    of the share of all clips. A row is compared with the row "all on" of its clip before it."""
    everything: dict[str, dict[str, str]] = {}
    by_clip: dict[str, tuple[dict[str, str], dict[str, str]]] = {}
    for row in rows:
        if row["without"] == "all on":
            everything[row["clip"]] = row
        elif row["without"] == name:
            by_clip[row["clip"]] = everything[row["clip"]], row
    pairs = list(by_clip.values())
    found = {}
    for measure in MEASURES:
        if measure in ("faces", "eyes"):
            on, off = (
                np.array([row[measure].split("/") for row in side], int).sum(0) for side in zip(*pairs, strict=True)
            )
            found[measure] = float(100 * (off[0] - on[0]) / max(on[1], 1))
        else:
            found[measure] = statistics.fmean(100 * (float(off[measure]) / float(on[measure]) - 1) for on, off in pairs)
    return found | {"difference": statistics.fmean(float(off["difference"]) for _, off in pairs), "clips": len(pairs)}


def table(path: Path) -> str:
    """The means as a Markdown table for each method."""
    with path.open() as file:
        rows = list(csv.DictReader(file))
    lines = []
    for method in dict.fromkeys(row["method"] for row in rows):
        own = [row for row in rows if row["method"] == method]
        columns = [*MEASURES, "difference", "clips"]
        lines += [f"\n{method}\n", f"| without | {' | '.join(columns)} |", "|---" * (len(columns) + 1) + "|"]
        for name in dict.fromkeys(row["without"] for row in own if row["without"] != "all on"):
            found = changes(own, name)
            cells = [f"{found[column]:+.1f}" for column in MEASURES]
            lines.append(f"| {name} | {' | '.join(cells)} | {found['difference']:.2f} | {found['clips']:.0f} |")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("method", choices=[*CORRECTIONS, "table"])
    parser.add_argument("results", type=Path)
    parser.add_argument("--pictures", type=Path)
    parser.add_argument("--only", nargs="*", default=())
    parser.add_argument("--clips", nargs="*", default=())
    given = parser.parse_args()
    if given.method == "table":
        print(table(given.results))
    else:
        run(given.method, given.results, given.pictures, given.only, given.clips)


if __name__ == "__main__":
    main()
