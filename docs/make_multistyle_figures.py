"""Draws the figures of docs/multistyle.md, and writes its tables and docs/design.schema.json.

python -m docs.make_multistyle_figures [MEDIA] [--only NAME ...]

NAME: styles, renderers, steady, effects, design, table
"""

from __future__ import annotations

import argparse
import itertools
import json
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks.clips import read_picture
from docs import parameters
from docs.pictures import CLIPS, DOCS, MEDIA, frames, grid, save
from pipeline.frames import Frame
from pipeline.methods.base import PreviewRequest
from pipeline.methods.multistyle import MultistyleParams, MultistyleSession
from pipeline.methods.multistyle.design import schema
from pipeline.methods.multistyle.effects import EFFECTS
from pipeline.methods.multistyle.preview import FoundRegions, preview_frame
from pipeline.methods.multistyle.styles import FIELDS, STYLES, Style
from pipeline.methods.multistyle.tubes import TubeTracker, merge_results, tubes_of

PAGE, FOLDER, SCHEMA = DOCS / "multistyle.md", DOCS / "multistyle", DOCS / "design.schema.json"
HEIGHT, LEAD = 432, 3
SHOWN: Mapping[str, int] = {"bunny": 450, "coffee": 60, "flower": 100, "blackswan": 10}
"""Clip -> the frame that is shown."""
LIMIT = 230_000
MARKS = {
    "styles": ("<!-- styles: written by docs/make_multistyle_figures.py -->", "<!-- end of styles -->"),
    "parameters": ("<!-- parameters: written by docs/make_multistyle_figures.py -->", "<!-- end of parameters -->"),
}
RIPPLES: dict[str, Any] = {
    "version": 1,
    "regions": {"swan": {"label": 255, "border": "sharp"}},
    "styles": {"plumage": {"base": "impressionism", "size": 9, "length": 40, "jitter": 0.2}},
    "keys": [
        {"region": "swan", "frame": 0, "style": "plumage"},
        {"region": "rest", "frame": 0, "style": "van-gogh", "set": {"size": 26}, "ease": "smooth"},
        {"region": "rest", "frame": 19, "style": "van-gogh", "set": {"size": 26, "hue": 40}},
    ],
    "directions": [
        {
            "region": "rest", "frame": 0, "edge_weight": 0.2,
            "elements": [{"pattern": "center", "at": [0.4, 0.75]}],
        }
    ],
}  # fmt: skip
"""The example of a design: a swan in fine strokes on rings of water whose hue changes."""


def painted(clip: str, **params: Any) -> Frame:
    """The shown frame of a clip, after a few before it."""
    made: Frame | None = None
    session: MultistyleSession | None = None
    for frame in lead(clip):
        session = session or MultistyleSession(MultistyleParams(**params), (frame.shape[1], frame.shape[0]))
        made = session.step(frame)
    assert made is not None
    return made


def lead(clip: str) -> list[Frame]:
    last = SHOWN[clip]
    return list(frames(CLIPS[clip], MEDIA, last - LEAD, last + 1, HEIGHT))


def styles() -> None:
    for clip in SHOWN:
        tiles = [painted(clip, style=name) for name in STYLES]
        save(grid(tiles, 2, [named.title for named in STYLES.values()]), FOLDER / f"styles_{clip}.jpg", LIMIT)


def renderers() -> None:
    """Draw a detail at full resolution: implicit and explicit strokes, and OpenCV's two painting filters."""
    source = lead("bunny")[-1]
    tiles = [painted("bunny", renderer=name) for name in ("implicit", "explicit")]
    bgr = cv2.cvtColor(source, cv2.COLOR_RGB2BGR)
    for theirs in (cv2.xphoto.oilPainting(bgr, 5, 1), cv2.stylization(bgr)):
        tiles.append(np.asarray(cv2.cvtColor(theirs, cv2.COLOR_BGR2RGB), np.uint8))
    part = [tile[60:330, 150:600] for tile in tiles]
    names = ["implicit", "explicit", "cv2.xphoto.oilPainting", "cv2.stylization"]
    save(grid(part, 2, names), FOLDER / "renderers.jpg", LIMIT)


def steady() -> None:
    """Draw a row of pixels over 60 frames, time from top to bottom: the painting, and independently painted frames."""
    source = list(frames(CLIPS["coffee"], MEDIA, 0, 60, 288))
    size, tiles = (source[0].shape[1], source[0].shape[0]), []
    for style in ("van-gogh", "pointillism"):
        for temporal in ("on", "off"):
            session = MultistyleSession(MultistyleParams.model_validate({"style": style, "temporal": temporal}), size)
            rows = np.stack([session.step(frame)[size[1] // 2] for frame in source])
            tiles.append(cv2.resize(rows, (size[0], 3 * len(rows)), interpolation=cv2.INTER_NEAREST))
    names = [f"{style}, {how}" for style in ("Van Gogh", "Pointillism") for how in ("over time", "frame by frame")]
    save(grid([np.asarray(tile, np.uint8) for tile in tiles], 2, names), FOLDER / "steady.jpg", LIMIT)


def effects() -> None:
    """Draw each effect at the start, in the middle and at the end of a video of 60 frames."""
    source = list(frames(CLIPS["coffee"], MEDIA, 0, 61, HEIGHT))[::10]
    size = (source[0].shape[1], source[0].shape[0])
    tubes, ids, results = TubeTracker(size, 0), [], []
    for number, frame in enumerate(source):
        found, result = tubes.step(frame)
        ids.append(found)
        results.append((number, result))
    listed = tubes_of([merge_results(results)], [(0, len(source))], size[1])
    objects = {one: tube.object for tube in listed for one in tube.ids}
    tiles = []
    for effect, style in (("rack-focus", "pointillism"), ("emphasis", "impressionism"), ("calm-to-stress", "van-gogh")):
        params = MultistyleParams.model_validate({"effect": effect, "style": style})
        for number in (0, 3, 6):
            regions = FoundRegions(lambda frame: ids[frame], objects)
            request = PreviewRequest(params, 0, [source[number]], number, len(source))
            tiles.append(preview_frame(request, regions))
    names = [f"{name}, {when}" for name in EFFECTS[1:] for when in ("start", "middle", "end")]
    save(grid(tiles, 3, names), FOLDER / "effects.jpg", LIMIT)


def design() -> None:
    """Draw a frame, and its painting with the example of a design."""
    folder = MEDIA / "davis" / "blackswan"
    mask = read_picture(sorted(folder.rglob("*.png"))[SHOWN["blackswan"]])[..., 0]
    source = lead("blackswan")
    maps = {0: np.asarray(cv2.threshold(mask, 0, 255, cv2.THRESH_BINARY)[1], np.uint8)}
    request = PreviewRequest(
        MultistyleParams(), 0, source, SHOWN["blackswan"], 20, {"design": RIPPLES}, {"masks": maps}
    )
    made = preview_frame(request)
    plain = painted("blackswan")
    save(grid([source[-1], plain, made], 3, ["the video", "one style", "the design"]), FOLDER / "design.jpg", LIMIT)


def styles_table() -> Iterator[str]:
    """Every named style's own parameters."""
    yield "| | " + " | ".join(named.title for named in STYLES.values()) + " |"
    yield "|---" * (len(STYLES) + 1) + "|"
    properties = Style.model_json_schema()["properties"]
    for name in FIELDS:
        cells = [f"{getattr(named.style, name):g}" for named in STYLES.values()]
        yield f"| `{name}`, {properties[name]['unit']} | " + " | ".join(cells) + " |"
    yield ""


def parameters_table() -> Iterator[str]:
    properties: Mapping[str, Mapping[str, Any]] = MultistyleParams.model_json_schema()["properties"]
    for group, members in itertools.groupby(properties.items(), key=lambda item: item[1]["group"]):
        yield f"### {group}"
        yield ""
        yield from parameters.table(dict(members))
        yield ""


def table() -> None:
    """Write the tables between their markers, and the schema of designs."""
    text = PAGE.read_text()
    for name, lines in (("styles", styles_table()), ("parameters", parameters_table())):
        begin, end = MARKS[name]
        before, _, rest = text.partition(begin)
        text = f"{before}{begin}\n\n" + "\n".join(lines) + f"{end}{rest.partition(end)[2]}"
    PAGE.write_text(text)
    SCHEMA.write_text(json.dumps(schema(), indent=1) + "\n")


ALL: Mapping[str, Callable[[], None]] = {
    "styles": styles, "renderers": renderers, "steady": steady, "effects": effects, "design": design, "table": table,
}  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("media", nargs="?", type=Path, default=MEDIA)
    parser.add_argument("--only", nargs="+", choices=ALL, default=list(ALL))
    args = parser.parse_args()
    globals()["MEDIA"] = args.media
    for name in args.only:
        ALL[name]()


if __name__ == "__main__":
    main()
