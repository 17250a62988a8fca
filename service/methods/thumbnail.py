"""A thumbnail for a method: a small procedural scene rendered by it, or a drawing."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from functools import cache
from html import escape
from zlib import crc32

import cv2

from pipeline.errors import ImpastoError
from pipeline.frames import Frame
from pipeline.methods import method as find_method
from pipeline.methods.base import Method
from pipeline.scenes import scene

log = logging.getLogger(__name__)

SIZE = (320, 180)
SCENE = "harbour"
FRAMES = 3
"""Frames after which a causal method's temporal filters have settled."""


@dataclass(frozen=True)
class Picture:
    data: bytes
    media_type: str


@cache
def thumbnail(name: str) -> Picture:
    """The thumbnail of the method `name`, 320x180 px, rendered once per process.

    Raises: BadParameter if there is no such method.
    """
    method = find_method(name)
    try:
        frame = _render(method)
    except ImpastoError:  # for example without a compute device, which listing methods must not need
        log.warning("No thumbnail of %s", method.name, exc_info=True)
        frame = None
    return _card(method) if frame is None else _photo(frame)


def _render(method: Method) -> Frame | None:
    session = method.stream(method.Params(), SIZE, 0, {})
    if session is None:
        return None
    made: Frame | None = None
    source = scene(SCENE, SIZE, FRAMES)
    for index in range(FRAMES):
        made = session.step(source.image(index))
    return made


def _photo(frame: Frame) -> Picture:
    _, data = cv2.imencode(".jpg", cv2.cvtColor(frame, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, 88])
    return Picture(data.tobytes(), "image/jpeg")


def _card(method: Method) -> Picture:
    """Flat regions with bold lines: hills, a sun, a house; colours follow from the method's name."""
    hue = crc32(method.name.encode()) % 360
    shapes = "".join(
        f'<path d="{path}" fill="hsl({(hue + turn) % 360} {saturation}% {light}%)" stroke="#221a2e" stroke-width="3"/>'
        for path, turn, saturation, light in _CARD
    )
    text = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {SIZE[0]} {SIZE[1]}" role="img">'
        f"<title>{escape(method.title)}</title>{shapes}</svg>"
    )
    return Picture(text.encode(), "image/svg+xml")


_CARD = (
    ("M-5-5h330v190h-330z", 200, 60, 82),
    ("M230 30a28 28 0 1 0 .1 0z", 40, 85, 65),
    ("M-5 120q60-70 130-20t110-10 90 20v80h-330z", 150, 40, 62),
    ("M-5 150q80-50 160-15t170-10v60h-330z", 110, 45, 48),
    ("M90 175v-60l30-25 30 25v60z", 10, 60, 58),
    ("M82 118l38-34 38 34z", 350, 55, 42),
)
