"""Draws the gallery from real renders of the media folder: docs/gallery/*.jpg, docs/gallery.md, the README's picture.

    python -m docs.make_gallery [MEDIA] [--only NAME ...]   draws the committed pictures
    python -m docs.make_gallery [MEDIA] --all FOLDER        draws a sheet of every clip, for private use only

Pictures are committed only of clips whose licence in the media folder's MANIFEST.md clearly allows it (`Clip.credit`)
and that show no face.
"""

from __future__ import annotations

import argparse
import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from docs.pictures import (
    CLIPS,
    DOCS,
    GAP_PX,
    LIMIT_BYTES,
    MEDIA,
    PAINTINGS,
    colours_of,
    film,
    frames,
    grid,
    length,
    painting,
    render,
    save,
    shrink,
)
from pipeline.colour.scheme import ColourStats
from pipeline.frames import Frame
from pipeline.methods.abstraction import Abstraction

GALLERY = DOCS / "gallery"
SCHEME_CLIPS = ("meadow", "harbour", "bird")


@dataclass(frozen=True)
class Scene:
    """A range of a clip, and the frames to show. It starts earlier, so that regions have become stable."""

    clip: str
    picks: tuple[int, ...]
    words: str = ""
    params: Mapping[str, Any] = field(default_factory=dict)

    @property
    def start(self) -> int:
        return max(0, self.picks[0] - 24)


SCENES: Mapping[str, Scene] = {
    "bird": Scene("bunny", (410, 450), "A static camera: tree and branch stay still while the bird moves."),
    "brook": Scene("bunny", (310, 350), "Grass, water and stones become flat shapes; blossoms are kept."),
    "meadow": Scene("bunny", (150, 225), "A slow pan: the regions move with the hills."),
    "burrow": Scene("bunny", (575, 640), "A dark wood and a bright lawn; the lettering stays sharp."),
    "coffee": Scene("coffee", (32, 104), "Wall and table are static; only the pouring moves."),
    "blackswan": Scene("blackswan", (8, 19), "Ripples turn into a few tones of water."),
    "flower": Scene("flower", (75, 140), "A time-lapse: there are hours between the two frames."),
    "harbour": Scene("harbour", (16, 60), "A pan over several boats, with gulls behind a tree."),
    "portrait": Scene("portrait", (14, 40), "The face keeps its eyes and mouth, because regions are finer there."),
}

HERO = {"bird": (450, 0.5), "brook": (310, 0.5), "coffee": (104, 0.45), "blackswan": (19, 0.42)}
"""Scene -> its frame, and the position of the dividing line as a fraction of the width."""

ALIKE = {"bird": 450, "coffee": 104, "blackswan": 19}
"""Scene -> the frame that every method paints."""
EXEMPLAR = "starry_night"
METHODS = {
    "abstraction": "Cartoon abstraction", "multistyle": "Painting in many styles", "patches": "Painting patches",
    "analogy": "Style by example: The Starry Night",
}  # fmt: skip

DETAILS = {"harbour": (16, 1080, (1000, 430)), "coffee": (104, 720, (430, 120))}
"""Scene -> its frame, the height of the painting, px, and the upper left corner of the detail (x, y), px."""
DETAIL_PX = (448, 336)
"""(width, height) of a detail, px; it is shown without scaling."""

PRESETS = ("bird", "harbour")
PICTURES = [
    *(f"methods_{name}" for name in ALIKE), *(f"details_{name}" for name in DETAILS), *SCENES,
    *(f"presets_{name}" for name in PRESETS),
    *(f"colours_{name}" for name in PAINTINGS), "hero", "methods",
]  # fmt: skip


def main() -> None:
    """Draw what the command line asks for."""
    parser = argparse.ArgumentParser(description="Draw the gallery.")
    parser.add_argument("media", nargs="?", type=Path, default=MEDIA, help="the folder that has MANIFEST.md")
    parser.add_argument("--all", type=Path, metavar="FOLDER", help="a sheet of every clip into FOLDER instead")
    parser.add_argument("--only", nargs="+", default=PICTURES, metavar="NAME", help=", ".join(PICTURES))
    chosen = parser.parse_args()
    if not (chosen.media / "MANIFEST.md").is_file():
        parser.error(f"{chosen.media} has no MANIFEST.md: name the media folder, for example ../shared/media.")
    if chosen.all:
        draw_all(chosen.media, chosen.all)
    else:
        draw_gallery(chosen.media, chosen.only)


def draw_all(media: Path, folder: Path) -> None:
    """Draw a sheet of six frames of every clip, whatever its licence."""
    for name, clip in CLIPS.items():
        count = length(clip, media)
        picks = [round((i + 0.5) * count / 6) for i in range(6)]
        pairs = [pair for i, pair in enumerate(render(frames(clip, media), {})) if i in picks]
        print(save(grid(_interleaved(pairs, 3), 3), folder / f"{name}.jpg", limit=1 << 20))


def draw_gallery(media: Path, only: Sequence[str]) -> None:
    """Draw the committed pictures whose names are in `only`, and write the page."""
    for name in only:
        folder, limit = (DOCS / "images", 260_000) if name in ("hero", "methods") else (GALLERY, LIMIT_BYTES)
        print(save(_picture(name, media), folder / f"{name}.jpg", limit))
    (DOCS / "gallery.md").write_text(page())


def _picture(name: str, media: Path) -> Frame:
    kind, _, rest = name.partition("_")
    if name == "hero":
        return hero(media)
    if name == "methods":
        tiles = _alike("bird", media, ALIKE["bird"], 540)
        return grid(list(tiles.values())[1:], 2, list(METHODS.values()), width=1200)
    if kind == "methods":
        tiles = _alike(rest, media, ALIKE[rest], 360)
        names = ["original", *METHODS.values(), "The Starry Night"]
        return grid([*tiles.values(), _cropped(painting(media, EXEMPLAR), 1.78)], 2, names)
    if kind == "details":
        return details(rest, media)
    if kind == "presets":
        return presets(SCENES[rest], media)
    if kind == "colours":
        return recoloured(rest, media)
    return grid(list(itertools.chain(*_frame_pairs(SCENES[name], media, SCENES[name].picks))), 2)


def _frame_pairs(
    scene: Scene, media: Path, picks: Sequence[int], params: Mapping[str, Any] | None = None,
    scheme: ColourStats | None = None, height: int = 540,
) -> list[tuple[Frame, Frame]]:  # fmt: skip
    """(original, cartoon) at each of the picks."""
    source = frames(CLIPS[scene.clip], media, scene.start, picks[-1] + 1, height)
    pairs = render(source, scene.params if params is None else params, scheme)
    return [pair for number, pair in enumerate(pairs, scene.start) if number in picks]


def _interleaved(pairs: Sequence[tuple[Frame, Frame]], columns: int) -> list[Frame]:
    """A row of originals over a row of their cartoons."""
    rows = [pairs[i : i + columns] for i in range(0, len(pairs), columns)]
    return [pair[side] for row in rows for side in (0, 1) for pair in row]


def _alike(
    name: str, media: Path, pick: int, height: int, methods: Iterable[str] = tuple(METHODS)
) -> dict[str, Frame]:  # fmt: skip
    """A frame of the video, and the same frame painted by each of these methods as a part of its film."""
    source = list(frames(CLIPS[SCENES[name].clip], media, max(0, pick - 11), pick + 1, height))
    tiles = {"original": source[-1]}
    for method in methods:
        exemplar = media / "style" / "paintings" / f"{EXEMPLAR}.jpg"
        films = film(source, method, style_output=exemplar) if method == "analogy" else film(source, method)
        tiles[method] = films[-1]
    return tiles


def details(name: str, media: Path) -> Frame:
    """A detail of one frame of the video, and of its paintings by the methods that need no input, without scaling."""
    pick, height, (x, y) = DETAILS[name]
    width, rows = DETAIL_PX
    tiles = _alike(name, media, pick, height, [method for method in METHODS if method != "analogy"])
    shown = [np.ascontiguousarray(tile[y : y + rows, x : x + width]) for tile in tiles.values()]
    return grid(shown, 2, ["original", *list(METHODS.values())[:3]], width=2 * width + GAP_PX)


def presets(scene: Scene, media: Path) -> Frame:
    """One frame of the video, and its paintings by default and with every preset of the method."""
    pick = scene.picks[:1]
    ((original, default),) = _frame_pairs(scene, media, pick, height=360)
    tiles, names = [original, default], ["original", "default"]
    for example in Abstraction.examples:
        tiles += [cartoon for _, cartoon in _frame_pairs(scene, media, pick, example.params, height=360)]
        names.append(example.title)
    return grid(tiles, 2, names)


def recoloured(name: str, media: Path) -> Frame:
    """A painting, and clips in its colours."""
    scheme = colours_of(media, name)
    tiles = [_cropped(painting(media, name))]
    for clip in SCHEME_CLIPS:
        pairs = _frame_pairs(SCENES[clip], media, SCENES[clip].picks[:1], {}, scheme, height=360)
        tiles += [cartoon for _, cartoon in pairs]
    return grid(tiles, 2)


def _cropped(picture: Frame, shape: float = 16 / 9) -> Frame:
    """The middle of a picture, at the shape of the clips beside it."""
    height, width = picture.shape[:2]
    h, w = min(height, round(width / shape)), min(width, round(height * shape))
    y, x = (height - h) // 3, (width - w) // 2
    return picture[y : y + h, x : x + w]


def hero(media: Path) -> Frame:
    """Four frames, each divided by a slanting line: video on the left, painting on the right."""
    panels = []
    for name, (pick, share) in HERO.items():
        ((original, cartoon),) = _frame_pairs(SCENES[name], media, [pick], height=720)
        panels.append(_split(shrink(_cropped(original), 720), shrink(_cropped(cartoon), 720), share))
    return grid(panels, 2, width=1444)


def _split(left: Frame, right: Frame, share: float, slant: float = 0.22) -> Frame:
    """`left` up to `share` of the width, `right` beyond, with a white line between."""
    height, width = left.shape[:2]
    ys, xs = np.mgrid[:height, :width]
    beyond = xs - width * (share + slant * (0.5 - ys / height))
    out = np.where(beyond[..., None] > 0, right, left)
    out[np.abs(beyond) < 2] = 255
    return np.asarray(cv2.GaussianBlur(out, (0, 0), 0.3), np.uint8)


def page() -> str:
    """docs/gallery.md."""
    return "\n".join([*_head(), *_methods(), *_details(), *_clips(), *_presets(), *_colours(), ""])


def _head() -> Iterator[str]:
    yield "# Gallery"
    yield ""
    yield "All pictures are real renders, made by `make gallery MEDIA=../shared/media`. Every parameter has its default"
    yield "unless a caption says otherwise. These pages describe the parameters: [abstraction](abstraction.md),"
    yield "[multistyle](multistyle.md), [patches](patches.md), [analogy](analogy.md)."


def _methods() -> Iterator[str]:
    yield from ("", "## One frame, every method")
    for name in ALIKE:
        yield from ("", f"![The same frame in every method: {name}](gallery/methods_{name}.jpg)", "")
        yield f"<sub>{CLIPS[SCENES[name].clip].credit} *The Starry Night*, Vincent van Gogh, 1889: public domain.</sub>"


def _details() -> Iterator[str]:
    yield from ("", "## Details at full resolution")
    for name, (pick, height, _) in DETAILS.items():
        clip = CLIPS[SCENES[name].clip]
        yield from ("", f"![A detail of frame {pick} in three methods: {name}](gallery/details_{name}.jpg)", "")
        yield f"Frame {pick} of {clip.title.lower()}, painted at a height of {height} px; the detail is not scaled.  "
        yield f"<sub>{clip.credit}</sub>"


def _clips() -> Iterator[str]:
    yield from ("", "## Cartoons, original on the left")
    for name, scene in SCENES.items():
        clip = CLIPS[scene.clip]
        title = clip.title if clip.title.lower() == name else f"{clip.title}: {name}"
        yield from ("", f"### {title}", "", f"![{title}: original and cartoon](gallery/{name}.jpg)", "")
        yield f"{scene.words} Frames {' and '.join(str(pick) for pick in scene.picks)}.  "
        yield f"<sub>{clip.credit}</sub>"


def _presets() -> Iterator[str]:
    yield from ("", "## Ready-made looks", "")
    for example in Abstraction.examples:
        values = " ".join(f"--param {key}={value}" for key, value in example.params.items())
        yield f"- **{example.title}**: `{values}`"
    for name in PRESETS:
        yield from ("", f"![The {name} with every preset](gallery/presets_{name}.jpg)", "")
        yield f"<sub>{CLIPS[SCENES[name].clip].credit}</sub>"


def _colours() -> Iterator[str]:
    yield from ("", "## Colours of a painting", "")
    yield "With `--input reference=painting.jpg`, hues move to the nearest peak of the painting's hue histogram, and"
    yield "saturation and brightness to the painting's own; whites and greys do not change."
    thanks = " ".join(dict.fromkeys(CLIPS[SCENES[clip].clip].credit for clip in SCHEME_CLIPS))
    for name, (title, painter) in PAINTINGS.items():
        yield from ("", f"![{title}, and three clips in its colours](gallery/colours_{name}.jpg)", "")
        yield f"*{title}*, {painter}, and three clips in its colours.  "
        yield f"<sub>The painting is in the public domain. {thanks}</sub>"


if __name__ == "__main__":
    main()
