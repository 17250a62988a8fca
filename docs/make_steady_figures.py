"""Draws the figure of docs/steady.md, and writes its table of parameters.

python -m docs.make_steady_figures [MEDIA] [--only table]
"""

from __future__ import annotations

import itertools
import sys
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from docs import parameters
from docs.pictures import CLIPS, DOCS, MEDIA
from pipeline.frames import Frame
from pipeline.methods.steady import SteadyFilter, SteadyParams
from pipeline.video.reader import VideoReader

PAGE, PICTURE = DOCS / "steady.md", DOCS / "steady" / "slits.jpg"
MARKS = ("<!-- parameters: written by docs/make_steady_figures.py -->", "<!-- end of parameters -->")
SIZE, FRAMES, ROW = (640, 360), 40, 150
STRETCH = 5
"""Rows of the picture for each frame."""


def oil(frame: Frame) -> Frame:
    """The frame, painted on its own by OpenCV."""
    return np.ascontiguousarray(cv2.xphoto.oilPainting(np.ascontiguousarray(frame[..., ::-1]), 4, 1)[..., ::-1])


def slits(media: Path) -> Frame:
    """One row of pixels over time, from top to bottom: source, frame-by-frame oil painting and steady, side by side."""
    steady = SteadyFilter(SteadyParams(), SIZE)
    rows: list[Frame] = []
    with VideoReader(media / CLIPS["coffee"].path) as reader:
        for frame in itertools.islice(reader.read(), FRAMES):
            source: Frame = np.asarray(cv2.resize(frame, SIZE, interpolation=cv2.INTER_AREA), np.uint8)
            styled = oil(source)
            parts = (source, styled, steady.step(source, styled))
            rows.append(np.concatenate([part[ROW, 180:460] for part in parts]))
    return np.repeat(np.stack(rows), STRETCH, axis=0)


def parameters_table() -> Iterator[str]:
    """Every parameter, from the schema."""
    yield from parameters.table(SteadyParams.model_json_schema()["properties"])


def table() -> None:
    """Write the table between its markers."""
    begin, end = MARKS
    before, _, rest = PAGE.read_text().partition(begin)
    PAGE.write_text(f"{before}{begin}\n\n" + "\n".join(parameters_table()) + f"\n\n{end}{rest.partition(end)[2]}")


def main(words: list[str]) -> None:
    """Write both."""
    table()
    if "--only" not in words:
        PICTURE.parent.mkdir(exist_ok=True)
        picture = slits(Path(words[0]) if words else MEDIA)
        cv2.imwrite(str(PICTURE), picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 85])


if __name__ == "__main__":
    main(sys.argv[1:])
