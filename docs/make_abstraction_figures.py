"""Draws the figures of docs/abstraction.md from real intermediate results, and writes its table of parameters.

python -m docs.make_abstraction_figures [MEDIA] [--only NAME ...]    NAME: a parameter, pipeline, svg or table
"""

from __future__ import annotations

import argparse
import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from docs.parameters import rewrite
from docs.pictures import CLIPS, DOCS, MEDIA, OURS, Clip, colours_of, frames, grid, render, save, session_for
from pipeline.frames import Flow, Frame, Labels, Plane
from pipeline.methods.abstraction import Abstraction, AbstractionParams, AbstractionSession
from pipeline.perception.flow import estimate
from pipeline.regions.propagation import propagate, smooth_labels
from pipeline.vector.svg import to_svg

FOLDER = DOCS / "abstraction"
HEIGHT = 360
WARM_UP, WATCHED = 14, 10
"""Number of frames before the displayed one, and number of frames over which change is averaged."""
LOUDER = 40
"""Factor by which change is amplified in figures, dark on white."""
STILL_LEVELS = 3.0
"""Mean change per frame of a pixel's surroundings, gray levels, below which the pixel counts as static."""
MOVES = (214, 226, 240)
Settings: TypeAlias = tuple[tuple[str, Any], ...]


HAZE_LEVEL = 140
"""Gray level of haze."""


@dataclass(frozen=True)
class Strip:
    """The effect of a parameter: the same frame at three values; the middle one is the default."""

    clip: str
    frame: int
    values: tuple[Any, ...]
    """The two other values, in ascending order. If the default is the lowest or highest value, they follow it."""
    words: str
    show: Literal["picture", "change", "flow", "importance"] = "picture"
    """Kind of drawing: the picture, its change between frames where the video is static, the optical flow, or I(p)."""
    painting: str = ""
    zoom: tuple[float, float, float] = (0, 0, 1)
    """(left, top, side) of the displayed part, as fractions of the frame."""
    height: int = HEIGHT
    """Height of the frames, px."""
    haze: float = 0
    """Weight of haze in the frames, 0..1."""


CUT = Clip("Cut", "cut", OURS)
BIRD = ("bunny", 450)
BROOK = ("bunny", 310)
MEADOW = ("bunny", 225)
CHANGE = "how much each still pixel changes from frame to frame (darker = more; mean in 8-bit levels; blue = moves)"

STRIPS: Mapping[str, Strip] = {
    "algorithm": Strip(
        "coffee",
        40,
        ("printed",),
        "the default and the preset of the printed algorithm; below, both without lines.",
        height=480,
    ),
    "growing_limit": Strip(*BIRD, (9, 45), "more shades at low values, few flat areas at high values."),
    "core_tolerance": Strip(*BIRD, (0.2, 1.5), "the number of bands in the sky."),
    "smallest_region": Strip(*BROOK, (0, 3), "small regions such as blossoms and pebbles, or large ones only."),
    "merge_similar": Strip(*BIRD, (0, 20), "similar shades stay separate at low values and are merged at high values."),
    "edge_threshold": Strip(
        *BROOK, (25, 700), "at low values edges separate blades of grass; at high values only colour separates regions."
    ),
    "boundary_smoothing": Strip(*BROOK, (0, 16), "borders along pixels, or rounded.", zoom=(0.4, 0.45, 0.5)),
    "edges": Strip(*BIRD, ("sharp",), "the width of edges; at this size auto is soft.", zoom=(0.3, 0.1, 0.4)),
    "analysis": Strip(
        "coffee",
        40,
        ("full",),
        "frames of 720 lines, at their own size: the smallest regions.",
        zoom=(0.25, 0.1, 0.4),
        height=720,
    ),
    "contrast_adaptation": Strip(
        "harbour", 60, (0, 0.5), "in haze, few regions as in the paper, or those of a clear day.", haze=0.6
    ),
    "temporal": Strip("coffee", 40, ("off",), f"{CHANGE}.", show="change"),
    "flow": Strip("harbour", 60, ("dis-medium", "tvl1"), "the estimated motion; hue shows its direction.", show="flow"),
    "flow_error_limit": Strip(
        "bunny", 410, (2, 60), "at high values labels remain where the motion is wrong.", zoom=(0.3, 0, 0.5)
    ),
    "steadiness": Strip(*BIRD, (0, 0.95), f"{CHANGE}. A webcam gains more.", show="change"),
    "stillness": Strip(*BIRD, (0, 10), f"{CHANGE}.", show="change"),
    "boundary_margin": Strip("coffee", 40, (0, 40), f"{CHANGE}.", show="change"),
    "paint_memory": Strip(*BIRD, (0, 0.95), f"{CHANGE}.", show="change"),
    "colour_half_life": Strip("flower", 14, (0, 30), f"{CHANGE}; here the exposure drifts.", show="change"),
    "cut_sensitivity": Strip(
        "cut",
        48,
        (0, 3),
        "the first frame after a cut. At 0, labels of the previous shot remain where their colours fit.",
    ),
    "face_importance": Strip(
        "portrait", 30, (0, 0.5), "more detail at eyes and mouth at higher values.", zoom=(0.25, 0.05, 0.5)
    ),
    "saliency_importance": Strip("flower", 140, (0, 1), "finer regions on salient things."),
    "motion_importance": Strip("coffee", 40, (0, 1), "the importance map; the pouring arm moves.", show="importance"),
    "importance_half_life": Strip(
        "bunny", 410, (0, 40), "the importance map of this frame, or averaged over many frames.", show="importance"
    ),
    "lines": Strip(*BIRD, ("off",), "with lines and without.", zoom=(0.3, 0.1, 0.5)),
    "line_width": Strip(*BIRD, (1.2, 6), "from thin to broad lines.", zoom=(0.2, 0.1, 0.6)),
    "line_threshold": Strip(*BROOK, (0.3, 4), "lines at every fold, or at strong contours only."),
    "line_sharpness": Strip(
        *BIRD, (0.15, 6), "gradual or abrupt transition between line and ground.", zoom=(0.2, 0.1, 0.6)
    ),
    "line_colour": Strip(*BIRD, ("#7a1f1f", "#1f3d7a"), "red, warm black and blue ink.", zoom=(0.2, 0.1, 0.6)),
    "line_opacity": Strip(*BIRD, (0.35, 1), "from faint to black lines.", zoom=(0.2, 0.1, 0.6)),
    "line_length": Strip(*MEADOW, (0, 200), "short and long lines, or long ones only.", zoom=(0.35, 0.2, 0.6)),
    "mean_shift_steps": Strip(*MEADOW, (0, 12), "towards the hues of *The Great Wave*.", painting="great_wave"),
    "hue_neighbourhood": Strip(*MEADOW, (8, 150), "the nearest peak, or the largest.", painting="great_wave"),
    "keep_brightness": Strip(
        *MEADOW, (0, 1), "with *The Starry Night*: its darkness, or the video's light.", painting="starry_night"
    ),
    "vividness": Strip("blackswan", 16, (0.4, 2), "weak or strong saturation."),
    "palette": Strip(
        *MEADOW,
        (("#1d2b3a", "#2f6f5e", "#8fae5d", "#f2e3b6"), ("#2b1a3d", "#e8a87c", "#f6e7cb", "#3f6c8f")),
        "the regions' own colours, greens and cream, orange and blue.",
    ),
}


def main() -> None:
    """Draw what the command line asks for."""
    parser = argparse.ArgumentParser(description="Draw the figures of docs/abstraction.md.")
    parser.add_argument("media", nargs="?", type=Path, default=MEDIA, help="the folder that has MANIFEST.md")
    parser.add_argument("--only", nargs="+", default=["pipeline", "svg", *STRIPS, "table"])
    chosen = parser.parse_args()
    for name in chosen.only:
        draw(name, chosen.media)


def draw(name: str, media: Path) -> None:
    """One figure."""
    if name == "algorithm":
        print(save(algorithms(media), FOLDER / "algorithm.jpg", limit=120_000))
    elif name == "table":
        rewrite(captions())
    elif name == "pipeline":
        print(save(pipeline(media), FOLDER / "pipeline.jpg", limit=150_000))
    elif name == "svg":
        draw_svg(media)
    else:
        print(save(strip(name, media), FOLDER / f"{name}.jpg", limit=45_000))


def captions() -> dict[str, str]:
    """Caption of each parameter's figure."""
    return {
        name: f"{', '.join(_label(value) for value in _values(name))}: {shown.words}" for name, shown in STRIPS.items()
    }


def _label(value: Any) -> str:
    return (" ".join(value) or "none") if isinstance(value, tuple) else str(value)


def _values(name: str) -> tuple[Any, ...]:
    """The displayed values: low, default, high; the default comes first if the values have no order."""
    default = AbstractionParams.model_fields[name].default
    others = STRIPS[name].values
    if isinstance(default, (str, tuple)):
        return (default, *others)
    return tuple(sorted((round_(default), *others)))


# -- strips


def strip(name: str, media: Path) -> Frame:
    """The effect of the parameter `name`."""
    shown = STRIPS[name]
    default = AbstractionParams.model_fields[name].default
    tiles, names = [], []
    for value in _values(name):
        params = () if value in (default, round_(default)) else ((name, value),)
        tile, suffix = _tile(shown, media, params)
        tiles.append(tile)
        names.append(f"{_label(value)}{suffix}")
    return grid(tiles, 3, names)


def round_(value: Any) -> Any:
    """A default, rounded for display."""
    return round(value, 2) if isinstance(value, float) else value


def _tile(shown: Strip, media: Path, params: Settings) -> tuple[Frame, str]:
    if shown.show == "flow":
        return _motion(shown, media, params), ""
    if shown.show == "importance":
        return _importance(shown, media, params), ""
    pairs = _pairs(shown, media, params)
    if shown.show == "picture":
        return _zoomed(pairs[-1][1], shown.zoom), ""
    picture, mean = show_change(*zip(*pairs, strict=True))
    return picture, f"   (mean {mean:.2f})"


def _motion(shown: Strip, media: Path, params: Settings) -> Frame:
    before, now = frames(CLIPS[shown.clip], media, shown.frame - 1, shown.frame + 1, HEIGHT)
    return show_flow(estimate(before, now, AbstractionParams(**dict(params)).flow))


def _importance(shown: Strip, media: Path, params: Settings) -> Frame:
    source = list(frames(CLIPS[shown.clip], media, shown.frame - WARM_UP, shown.frame + 1, HEIGHT))
    session = session_for(source[0], dict(params))
    planes = [session.analyzer.step(frame).importance.result() for frame in source]
    return _at(show_plane(planes[-1]), (source[0].shape[1], source[0].shape[0]))


def show_change(originals: Sequence[Frame], cartoons: Sequence[Frame]) -> tuple[Frame, float]:
    """Map of the change between frames where the original is static, dark on white, and its mean (8-bit levels).

    Pixels where the original moves are blue.
    """
    change, motion = _change(cartoons), cv2.blur(_change(originals), (9, 9))
    still = motion < STILL_LEVELS
    dark = np.clip(255 - LOUDER * change, 0, 255).astype(np.uint8)
    picture = np.where(still[..., None], dark[..., None], np.array(MOVES, np.uint8))
    return np.asarray(picture, np.uint8), float(change[still].mean()) if still.any() else 0.0


def _change(pictures: Sequence[Frame]) -> NDArray[Any]:
    return np.asarray(np.mean([cv2.absdiff(a, b).max(axis=-1) for a, b in itertools.pairwise(pictures)], axis=0))


@lru_cache(maxsize=8)
def _pairs(shown: Strip, media: Path, params: Settings) -> list[tuple[Frame, Frame]]:
    """(original, cartoon) of the last `WATCHED` frames up to the displayed one."""
    clip = CUT if shown.clip == "cut" else CLIPS[shown.clip]
    source = frames(clip, media, max(0, shown.frame - WARM_UP), shown.frame + 1, shown.height)
    scheme = colours_of(media, shown.painting) if shown.painting else None
    return list(render((_in_haze(frame, shown.haze) for frame in source), dict(params), scheme))[-WATCHED:]


def _in_haze(frame: Frame, haze: float) -> Frame:
    return np.asarray(np.rint((1 - haze) * frame + HAZE_LEVEL * haze), np.uint8)


def _zoomed(picture: Frame, part: tuple[float, float, float]) -> Frame:
    left, top, side = part
    height, width = picture.shape[:2]
    y, x = round(top * height), round(left * width)
    return picture[y : y + round(side * height), x : x + round(side * width)]


def algorithms(media: Path) -> Frame:
    """A frame by default and with the preset of the printed algorithm, and both without lines."""
    (preset,) = [example.params for example in Abstraction.examples if example.name == "printed"]
    shown = STRIPS["algorithm"]
    ways: list[dict[str, Any]] = [{}, dict(preset), {"lines": "off"}, {**preset, "lines": "off"}]
    pictures = [_pairs(shown, media, tuple(params.items()))[-1] for params in ways]
    tiles = [_zoomed(tile, shown.zoom) for _, tile in pictures]
    return grid(tiles, 2, ["extended", "printed, as its preset", "extended, no lines", "printed, no lines"])


# -- pipeline


def pipeline(media: Path) -> Frame:
    """The results of all stages for one frame, computed by the method itself."""
    *before, frame = frames(CLIPS["bunny"], media, 390, 411, 540)
    session = session_for(frame, {})
    for earlier in before:
        session.step(earlier)
    known = session.regions.segmenter.last
    analysis = session.analyzer.step(frame)
    if known is None or analysis.flow is None or analysis.residual is None or analysis.lines is None:
        raise RuntimeError("The figure needs a frame with previous frames.")
    limit = session.regions.segmenter.params.flow_error_limit
    remainder = session.regions.segmenter.remainder
    propagated = smooth_labels(propagate(known.labels, analysis.flow, remainder, analysis.residual, limit)[0])
    session.compositor.prepare(analysis)
    session.compositor.prepare(analysis)
    sketch = session.regions.step(analysis)
    painting = session.compositor.step(session.compositor.outline(sketch))
    tiles = {
        "1 the frame": frame,
        "2 optical flow": show_flow(analysis.flow),
        "3 settled with its past": cv2.cvtColor(analysis.lab, cv2.COLOR_LAB2RGB),
        "4 importance": show_plane(analysis.importance.result()),
        "5 edges, by importance": 255 - np.dstack([analysis.edges.result()] * 3),
        "6 labels carried (red: none)": show_labels(propagated, known.ids),
        "7 labels completed": show_labels(sketch.regions.labels, sketch.regions.ids),
        "8 region colours": sketch.colours[sketch.regions.labels],
        "9 boundaries rounded": sketch.colours[painting.labels],
        "10 lines": 255 - np.dstack([analysis.lines.result().coverage] * 3),
        "11 the picture": painting.frame,
        "12 in the Great Wave's colours": _in_colours(media, [*before, frame]),
    }
    size = (frame.shape[1], frame.shape[0])
    return grid([_at(tile, size) for tile in tiles.values()], 3, list(tiles))


def _at(tile: NDArray[Any], size: tuple[int, int]) -> Frame:
    return np.asarray(cv2.resize(tile, size, interpolation=cv2.INTER_AREA), np.uint8)


def _in_colours(media: Path, source: list[Frame]) -> Frame:
    return [cartoon for _, cartoon in render(source, {}, colours_of(media, "great_wave"))][-1]


def show_flow(flow: Flow) -> Frame:
    """Draw a flow: direction as hue, speed as saturation, white = static."""
    speed = np.hypot(flow[..., 0], flow[..., 1])
    hue = np.degrees(np.arctan2(flow[..., 1], flow[..., 0])) % 360 / 2
    saturation = 255 * np.clip(speed / max(1e-6, float(np.percentile(speed, 99))), 0, 1)
    hsv = np.dstack([hue, saturation, np.full_like(hue, 255)]).astype(np.uint8)
    return np.asarray(cv2.cvtColor(hsv, cv2.COLOR_HSV2RGB), np.uint8)


def show_plane(plane: Plane) -> Frame:
    """0 = black, 1 = white."""
    return np.dstack([(255 * plane).astype(np.uint8)] * 3)


def show_labels(labels: Labels, ids: NDArray[np.int64]) -> Frame:
    """Draw regions in colours that follow from their permanent ids; unlabelled pixels are red."""
    hue = ids * 67 % 180
    value = 150 + ids * 31 % 90
    hsv = np.stack([hue, np.full_like(hue, 90), value], axis=-1).astype(np.uint8)
    colours = cv2.cvtColor(hsv[None], cv2.COLOR_HSV2RGB)[0]
    colours[0] = (230, 20, 20)
    return np.asarray(colours[labels], np.uint8)


# -- vectors


def draw_svg(media: Path) -> None:
    """Two frames as SVG: the same region has the same id in both."""
    session: AbstractionSession | None = None
    for index, frame in enumerate(frames(CLIPS["harbour"], media, 40, 61, 270)):
        session = session or session_for(frame, {"smallest_region": 1.0})
        painting = session.finish(session.analyze(frame))
        if index in (0, 20):
            page = to_svg(painting.labels, painting.colours, ids=painting.regions.ids, tolerance_px=0.7)
            path = FOLDER / f"harbour_{40 + index:05d}.svg"
            path.parent.mkdir(exist_ok=True)
            path.write_bytes(page)
            print(path, len(page), "bytes")


if __name__ == "__main__":
    main()
