"""Helpers of the figure scripts: clips with their credits, renders, labelled tiles, JPEG files of limited size."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks.clips import read_picture
from pipeline.colour.scheme import ColourStats, learn
from pipeline.frames import Frame
from pipeline.methods.abstraction import AbstractionParams, AbstractionSession
from pipeline.scenes import scene, scenes
from pipeline.video.reader import VideoReader
from pipeline.video.stills import encode_png

DOCS = Path(__file__).resolve().parent
MEDIA = DOCS.parent.parent / "shared" / "media"
WIDTH_PX, GAP_PX = 900, 4
"""Width of a figure, and the gap between its tiles, px."""
LIMIT_BYTES = 120_000
PAPER, TEXT = 255, (70, 70, 70)


@dataclass(frozen=True)
class Clip:
    """A video used in figures, and its credit."""

    title: str
    path: str
    """Path below the media folder, or the name of a procedural scene."""
    credit: str = ""
    """Markdown. Empty: the licence does not clearly allow publication, so pictures of the clip are never committed."""


BLENDER = (
    "*Big Buck Bunny*, © 2008 Blender Foundation, [bigbuckbunny.org](https://www.bigbuckbunny.org), "
    "[CC BY 3.0](https://creativecommons.org/licenses/by/3.0/); stylised here."
)
DAVIS = (
    "DAVIS 2017 ([davischallenge.org](https://davischallenge.org)), "
    "[CC BY 4.0](https://creativecommons.org/licenses/by/4.0/); stylised here."
)
SAM = "A demo clip of [SAM 2](https://github.com/facebookresearch/sam2), Apache-2.0; stylised here."
OURS = "Our own procedural scene (`impasto scene`), Apache-2.0 like the rest."

CLIPS: Mapping[str, Clip] = {
    "bunny": Clip("Big Buck Bunny", "video/bunny_30s_720p.webm", BLENDER),
    "blackswan": Clip("Black swan", "davis/blackswan/frames", DAVIS),
    "coffee": Clip("Coffee", "video/coffee_720p_audio.mp4", SAM),
    "flower": Clip(
        "A flower opens", "video/flower_timelapse_540p.mp4",
        "From MDN's [interactive examples](https://github.com/mdn/interactive-examples), CC0 1.0.",
    ),
    "cockatoo": Clip(
        "Cockatoo", "video/cockatoo_720p_yuv444.mp4",
        "From [imageio's test images](https://github.com/imageio/imageio-binaries), public domain to the best of its "
        "knowledge.",
    ),
    "harbour": Clip("Harbour", "harbour", OURS),
    "portrait": Clip("Portrait", "portrait", OURS),
    **{
        name: Clip(name.replace("_", " "), path)
        for name, path in {
            "asl_walk": "video/asl_walk_640x480.mkv", "bikes": "video/bikes_scene_cuts.mp4",
            "bmx": "davis/bmx-trees/frames", "carphone": "video/carphone_qcif.mp4",
            "chaplin": "video/chaplin_bw_audio.mp4", "dance": "davis/dance-twirl/frames",
            "dog": "video/dog_720p_audio.mp4", "face": "video/face_portrait_768x1024.mp4",
            "foreman": "video/foreman_cif.mp4", "head_turn": "video/head_turn.gif", "juggle": "video/juggle_720p.mp4",
            "marathon": "video/marathon_720x400.mp4", "seattle": "video/seattle_pan_640x360.avi",
            "street": "video/street_pan_1080p.mp4",
        }.items()
    },
}  # fmt: skip

PAINTINGS: Mapping[str, tuple[str, str]] = {
    "great_wave": ("The Great Wave", "Katsushika Hokusai, 1831"),
    "starry_night": ("The Starry Night", "Vincent van Gogh, 1889"),
    "water_lilies": ("Water Lilies", "Claude Monet, 1919"),
    "delaunay_1906": ("Portrait", "Robert Delaunay, 1906"),
}
"""Public-domain paintings used as colour references: file stem -> title, painter and year."""


def frames(clip: Clip, media: Path, start: int = 0, stop: int | None = None, height: int = 540) -> Iterator[Frame]:
    """Frames [start, stop) of a clip, at most `height` px high."""
    if clip.path in scenes():
        shot = scene(clip.path, size=(height * 16 // 9, height))
        yield from (shot.image(index) for index in range(start, shot.frames if stop is None else stop))
        return
    with VideoReader(media / clip.path) as reader:
        for frame in reader.read(start, reader.frames if stop is None else min(stop, reader.frames)):
            yield shrink(frame, round(frame.shape[1] * min(1.0, height / frame.shape[0])))


def length(clip: Clip, media: Path) -> int:
    """Number of frames of a clip."""
    if clip.path in scenes():
        return scene(clip.path).frames
    with VideoReader(media / clip.path) as reader:
        return reader.frames


def painting(media: Path, name: str) -> Frame:
    """A painting of the media folder."""
    with VideoReader(media / "style" / "paintings" / f"{name}.jpg") as reader:
        return next(reader.read(0, 1))


def colours_of(media: Path, name: str) -> ColourStats:
    """The colour scheme of a painting."""
    return learn([painting(media, name)])


def session_for(frame: Frame, params: Mapping[str, Any], scheme: ColourStats | None = None) -> AbstractionSession:
    """A session for frames like this one."""
    return AbstractionSession(AbstractionParams(**params), (frame.shape[1], frame.shape[0]), scheme)


def render(
    source: Iterable[Frame], params: Mapping[str, Any], scheme: ColourStats | None = None
) -> Iterator[tuple[Frame, Frame]]:  # fmt: skip
    """(original, cartoon) of each frame."""
    session: AbstractionSession | None = None
    for frame in source:
        session = session or session_for(frame, params, scheme)
        yield frame, session.step(frame)


def film(
    source: Iterable[Frame], method: str, params: Mapping[str, Any] | None = None, **inputs: Path
) -> list[Frame]:  # fmt: skip
    """Frames as `impasto render` paints them, with any method and its whole plan."""
    with tempfile.TemporaryDirectory(prefix="impasto-pictures-") as scratch:
        shots, out = Path(scratch, "in"), Path(scratch, "out")
        shots.mkdir()
        for number, frame in enumerate(source):
            shots.joinpath(f"{number:04d}.png").write_bytes(encode_png(frame))
        words = ["render", shots, "-o", f"{out}/", "--method", method, "--workers", 2, "--home", scratch, "--quiet"]
        words += [word for name, value in (params or {}).items() for word in ("--param", f"{name}={value}")]
        words += [word for name, path in inputs.items() for word in ("--input", f"{name}={path}")]
        subprocess.run([sys.executable, "-m", "impasto", *map(str, words)], check=True, stdout=subprocess.DEVNULL)
        return [read_picture(path) for path in sorted(out.glob("*.png"))]


def shrink(frame: Frame, width: int) -> Frame:
    """The frame scaled to `width` px with its aspect ratio; unchanged if it already has that width."""
    if frame.shape[1] == width:
        return frame
    size = (width, round(frame.shape[0] * width / frame.shape[1]))
    return np.asarray(cv2.resize(frame, size, interpolation=cv2.INTER_AREA), np.uint8)


def grid(tiles: Sequence[Frame], columns: int, names: Sequence[str] = (), width: int = WIDTH_PX) -> Frame:
    """Tiles of equal size in rows with a total width of `width` px, each with its name below it."""
    side = (width - (columns - 1) * GAP_PX) // columns
    made = [_named(shrink(tile, side), names[i] if names else "") for i, tile in enumerate(tiles)]
    height = max(tile.shape[0] for tile in made)
    rows = -(-len(made) // columns)
    sheet = np.full((rows * (height + GAP_PX) - GAP_PX, columns * (side + GAP_PX) - GAP_PX, 3), PAPER, np.uint8)
    for i, tile in enumerate(made):
        y, x = i // columns * (height + GAP_PX), i % columns * (side + GAP_PX)
        sheet[y : y + tile.shape[0], x : x + side] = tile
    return sheet


def _named(tile: Frame, name: str) -> Frame:
    if not name:
        return tile
    strip = np.full((22, tile.shape[1], 3), PAPER, np.uint8)
    cv2.putText(strip, name, (3, 15), cv2.FONT_HERSHEY_SIMPLEX, 0.44, TEXT, 1, cv2.LINE_AA)
    return np.vstack([tile, strip])


def save(picture: Frame, path: Path, limit: int = LIMIT_BYTES) -> Path:
    """Write a JPEG of at most `limit` bytes, at quality 82 or, if necessary, lower."""
    path.parent.mkdir(parents=True, exist_ok=True)
    for quality in range(82, 40, -4):
        options = [cv2.IMWRITE_JPEG_QUALITY, quality, cv2.IMWRITE_JPEG_OPTIMIZE, 1]
        data = cv2.imencode(".jpg", cv2.cvtColor(picture, cv2.COLOR_RGB2BGR), options)[1]
        if len(data) <= limit:
            break
    path.write_bytes(data.tobytes())
    return path
