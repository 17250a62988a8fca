"""Draws the figures of docs/analogy.md, each term of the energy on and off, and writes its table of parameters.

python -m docs.make_analogy_figures [MEDIA] [--only NAME ...]    NAME: one of `FIGURES`, or table
"""

from __future__ import annotations

import argparse
import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks.analogy_renders import Memory, render
from docs import parameters
from docs.pictures import CLIPS, DOCS, MEDIA, frames, grid, painting, save
from pipeline.frames import Frame
from pipeline.methods.analogy import AnalogyParams
from pipeline.methods.analogy.style_images import paint_in_strokes
from pipeline.methods.multistyle import MultistyleParams, MultistyleSession
from pipeline.scenes import scene
from pipeline.scenes.shot import shot_files
from pipeline.synthesis.distance import nearest, within_reach
from pipeline.video.stills import encode_gray_png, encode_png

PAGE, FOLDER = DOCS / "analogy.md", DOCS / "analogy"
HEIGHT, LIMIT = 240, 110_000
MARK = ("<!-- parameters: written by docs/make_analogy_figures.py -->", "<!-- end of parameters -->")
SIZE = (400, 225)
Settings = Mapping[str, Mapping[str, Any]]
"""Caption -> parameters."""


@cache
def style(name: str, side_px: int = 720) -> Frame:
    """A public-domain painting, scaled so that its longer side has `side_px` px."""
    whole = painting(MEDIA, name)
    scale = side_px / max(whole.shape[:2])
    return np.asarray(cv2.resize(whole, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), np.uint8)


@cache
def film(clip: str, start: int, count: int = 1, height: int = HEIGHT) -> tuple[Frame, ...]:
    return tuple(frames(CLIPS[clip], MEDIA, start, start + count, height))


def painted(source: Sequence[Frame], inputs: Mapping[str, Sequence[Frame]], **params: Any) -> list[Frame]:
    given = {"video": list(source), **{name: list(images) for name, images in inputs.items()}}
    return render(Memory(AnalogyParams(**params), given))


def shot(files: Mapping[str, bytes], source: Sequence[Frame], **params: Any) -> list[Frame]:
    return render(Memory(AnalogyParams(**params), {"video": list(source)}, files))


def put(name: str, tiles: Sequence[Frame], names: Sequence[str], columns: int | None = None) -> None:
    save(grid(tiles, columns or len(tiles), names), FOLDER / f"{name}.jpg", LIMIT)


def stills(
    name: str,
    clip: str,
    start: int,
    painter: str,
    settings: Mapping[str, Mapping[str, Any]],
    columns: int | None = None,
) -> None:
    """One frame with several settings."""
    source, given = film(clip, start), {"style_output": [style(painter)]}
    put(name, [painted(source, given, **params)[0] for params in settings.values()], list(settings), columns)


# -- a picture and its style


def paintings() -> None:
    """One frame in three paintings."""
    source = film("coffee", 60)
    tiles = [
        painted(source, {"style_output": [style(name)]})[0] for name in ("delaunay_1906", "great_wave", "starry_night")
    ]
    put("paintings", [source[0], *tiles], ["the video", "Delaunay", "Hokusai", "van Gogh"], 2)


def input_term() -> None:
    stills("input", "bunny", 450, "delaunay_1906", {f"w_in {w:g}": {"guide_weight": w} for w in (0, 1, 4, 20)}, 2)


def output_term() -> None:
    stills("output", "bunny", 450, "starry_night", {f"w_out {w:g}": {"texture_weight": w} for w in (0, 1, 5)})


def coherence_term() -> None:
    settings = {f"w_sc {w:g}": {"coherence_weight": w} for w in (0, 15, 150)}
    stills("coherence", "bunny", 450, "starry_night", settings)


def histogram_term() -> None:
    settings = {f"h_s {w:g}": {"variety_weight": w} for w in (0, 10, 200)}
    stills("histogram", "coffee", 60, "water_lilies", settings)


def rotation() -> None:
    """Rings on water in strokes of one direction, not rotated and rotated along the rings."""
    height, width = SIZE[1], SIZE[0]
    y, x = np.mgrid[:height, :width].astype(np.float32)
    rings = np.rint(127 + 90 * np.sin(np.hypot(x - width / 2, y - height * 0.6) / 9)).astype(np.uint8)
    plain = np.dstack([rings] * 3)
    rows = np.rint(127 + 90 * np.sin(np.arange(240, dtype=np.float32) / 9)).astype(np.uint8)
    bands = np.repeat(rows[:, None, None], 320, axis=1).repeat(3, axis=2)
    grain = np.random.default_rng(5).normal(0, 1, (240, 320)).astype(np.float32)
    streaks = cv2.GaussianBlur(grain, (0, 0), sigmaX=14, sigmaY=1.2)
    ink = bands.astype(np.float32) * (0.45, 0.62, 0.85) + 40 + streaks[..., None] * 260
    pair = {"style": [bands], "style_output": [np.clip(ink, 0, 255).astype(np.uint8)]}
    tiles = [painted([plain], pair, rotation=value, colour_weight=0)[0] for value in ("off", "on")]
    put("rotation", [pair["style_output"][0][:225, :], *tiles], ["the style", "rotation off", "rotation on"])


def lines() -> None:
    """Outlines of the scene, drawn with painted strokes."""
    made = scene("shapes", SIZE, frames=1).frame(0)
    drawn = np.dstack([np.rint(255 - 255 * made.lines).astype(np.uint8)] * 3)
    marks, strokes = stroke_style()
    given = {"style_output": [strokes], "style_lines": [marks], "lines": [drawn]}
    tiles = [painted([drawn], given, guide_weight=0, lines_weight=w, rotation="on")[0] for w in (0, 200)]
    put("lines", [drawn, strokes[:225, :400], *tiles], ["lines", "the style", "w_dt 0", "w_dt 200"], 2)


def stroke_style() -> tuple[Frame, Frame]:
    """Lines, and the same lines as rough strokes on paper."""
    marks = np.full((300, 400, 3), 255, np.uint8)
    for k in range(5):
        cv2.line(marks, (20, 30 + 60 * k), (380, 30 + 60 * k), (0, 0, 0), 2)
    rng = np.random.default_rng(2)
    noise = cv2.GaussianBlur(rng.normal(0, 1, (300, 400)).astype(np.float32), (0, 0), sigmaX=7, sigmaY=0.8)
    near = cv2.distanceTransform(cv2.cvtColor(marks, cv2.COLOR_RGB2GRAY), cv2.DIST_L2, 5)
    wet = np.clip(1.4 - near / 4.5 + noise * 2.6, 0, 1)[..., None]
    paper = 236 + rng.normal(0, 3, (300, 400, 1))
    return marks, np.clip(paper * (1 - wet) + np.array([46, 58, 96]) * wet, 0, 255).astype(np.uint8)


def pair_or_painting() -> None:
    """A derived style input, with and without matched tones."""
    source, given = film("bunny", 450), {"style_output": [style("water_lilies")]}
    settings = {"tones matched": "on", "not matched": "off"}
    tiles = [painted(source, given, tone_match=value)[0] for value in settings.values()]
    put("tones", [source[0], *tiles], ["the video", *settings])


def guides() -> None:
    """Texture by numbers: a map of the painting, and another map."""
    plain = scene("harbour", SIZE, frames=1).frame(0)
    palette = np.array([[40, 60, 200], [240, 200, 60], [60, 160, 60], [120, 70, 30], [200, 60, 60]], np.uint8)
    style_map = palette[plain.ids % 5]
    mirrored_map = np.ascontiguousarray(style_map[:, ::-1])
    art = _style_painted(plain.image, "impressionism")
    given = {"style_output": [art], "style_guide_a": [style_map], "guide_a": [mirrored_map]}
    out = painted([mirrored_map], given, guide_weight=0, guide_a_weight=6)[0]
    put("guides", [art, style_map, mirrored_map, out], ["the painting", "its map", "another map", "the result"], 2)


def _style_painted(plain: Frame, name: str) -> Frame:
    params = MultistyleParams.model_validate({"style": name})
    return MultistyleSession(params, (plain.shape[1], plain.shape[0])).step(plain)


# -- time


def temporal() -> None:
    """Three frames, coherent and independent."""
    source, given = film("coffee", 60, 3), {"style_output": [style("delaunay_1906")]}
    tiles = [tile for value in ("on", "off") for tile in painted(source, given, temporal=value)]
    put("temporal", tiles, [f"temporal {value}, frame {k}" for value in ("on", "off") for k in range(3)], 3)


def occlusion() -> None:
    """Disoccluded background behind a moving object, with and without chi."""
    made = scene("shapes", SIZE, frames=8)
    files = dict(shot_files(made))
    del files["shot.json"]
    source = [made.image(k) for k in range(8)]
    files["style/output.png"] = encode_png(style("delaunay_1906"))
    params = {"steadiness": 20, "guide_weight": 2, "tone_match": "off"}
    tiles = [shot(files, source, occlusion=value, **params)[5] for value in ("on", "off")]
    put("occlusion", [source[5], *tiles], ["the scene", "chi on", "chi off"])


def keyframes() -> None:
    """Two painted keys across a change of light, and the frames between them."""
    from benchmarks.analogy_claims import shaded_keys

    source, images = shaded_keys()
    rows = [
        render(Memory(AnalogyParams(key_blend=blend), {"video": source}, numbered={"keyframes": images}))
        for blend in (0, 1)
    ]
    chosen = (0, 3, 5, 7, 10)
    tiles = [row[k] for row in (source, *rows) for k in chosen]
    names = [[f"{name}, {place}" for place in ("key", "frame 3", "frame 5", "frame 7", "key")] for name in ("0", "1")]
    put("keyframes", tiles, [""] * 5 + names[0] + names[1], 5)


def overpaint() -> None:
    """Paint beyond the outline, five frames later: velocities extrapolated, and not."""
    size, count = (320, 180), 6
    made = scene("shapes", size, frames=count)
    source = [made.image(k) for k in range(count)]
    number = next(n for n, thing in made.things.items() if thing == "star")
    files = dict(shot_files(made, {"wall": tuple(t for t in made.things.values() if t != "star"), "star": ("star",)}))
    mask = made.frame(0).ids == number
    rough = np.random.default_rng(1).integers(0, 60, (*mask.shape, 3), dtype=np.uint8) + np.array(
        [190, 60, 30], np.uint8
    )
    key = np.dstack([rough, np.where(within_reach(nearest(mask), 9), 255, 0).astype(np.uint8)])
    files["layers/star/keyframes/0000.png"] = cv2.imencode(".png", cv2.cvtColor(key, cv2.COLOR_RGBA2BGRA))[1].tobytes()
    files["layers/wall/style/output.png"] = encode_png(
        paint_in_strokes(scene("portrait", (480, 320), frames=1).image(0))
    )
    with_reach = shot(files, source)
    alone = {name: data for name, data in files.items() if not name.startswith("layers/star/")}
    for k in range(count):
        alone[f"layers/star/masks/{k:04d}.png"] = encode_gray_png(
            np.where(made.frame(k).ids == number, 255, 0).astype(np.uint8)
        )
    alone["layers/star/keyframes/0000.png"] = files["layers/star/keyframes/0000.png"]
    alone["shot.json"] = files["shot.json"].replace(b'"name": "star",', b'"name": "star", "overpaint_px": 0,')
    cut = shot(alone, source)
    tiles = [with_reach[0], with_reach[-1], cut[-1]]
    put("overpaint", tiles, ["the key, painted 9 px beyond", "5 frames later", "overpaint_px 0: cut off"])


def layers() -> None:
    """The shot of examples/analogy.py."""
    from examples.analogy import LAYERS, STYLES

    made = scene("harbour", SIZE, frames=4)
    files = dict(shot_files(made, LAYERS))
    for layer, name in STYLES.items():
        files[f"layers/{layer}/style/input.png"] = encode_png(made.image(0))
        files[f"layers/{layer}/style/output.png"] = encode_png(_style_painted(made.image(0), name))
    source = [made.image(k) for k in range(4)]
    out = shot(files, source)
    put("layers", [source[3], out[3]], ["the scene", "four layers in four styles"])


# -- the page


def parameters_table() -> Iterator[str]:
    properties: Mapping[str, Mapping[str, Any]] = AnalogyParams.model_json_schema()["properties"]
    for group, members in itertools.groupby(properties.items(), key=lambda item: item[1]["group"]):
        yield f"### {group}"
        yield ""
        yield from parameters.table(dict(members))
        yield ""


def table() -> None:
    """Write the table of parameters between its markers."""
    before, _, after = PAGE.read_text().partition(MARK[0])
    rows = "\n".join(parameters_table())
    PAGE.write_text(f"{before}{MARK[0]}\n\n{rows}{MARK[1]}{after.partition(MARK[1])[2]}")


FIGURES: Mapping[str, Callable[[], None]] = {
    "paintings": paintings, "tones": pair_or_painting, "input": input_term, "output": output_term,
    "coherence": coherence_term, "histogram": histogram_term, "rotation": rotation, "lines": lines, "guides": guides,
    "temporal": temporal, "occlusion": occlusion, "keyframes": keyframes, "overpaint": overpaint, "layers": layers,
}  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("media", nargs="?", type=Path, default=MEDIA)
    parser.add_argument("--only", nargs="+", choices=[*FIGURES, "table"], default=[*FIGURES, "table"])
    args = parser.parse_args()
    globals()["MEDIA"] = args.media
    for name in args.only:
        {**FIGURES, "table": table}[name]()


if __name__ == "__main__":
    main()
