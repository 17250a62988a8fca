"""A thumbnail for a method: a small procedural scene rendered by it, or a drawing."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from functools import cache
from html import escape
from zlib import crc32

import cv2

from pipeline.errors import ImpastoError
from pipeline.method_names import BUILT_IN
from pipeline.methods import method as find_method
from pipeline.methods.base import Method
from pipeline.methods.live import Session
from pipeline.scenes import scene
from service.page_pictures import painted

log = logging.getLogger(__name__)

SIZE = (320, 180)
SCENE = "harbour"
FRAMES = 3
"""Frames after which a causal method's temporal filters have settled."""
JPEG_QUALITY = 88


@dataclass(frozen=True)
class Picture:
    data: bytes
    media_type: str


@cache
def thumbnail(name: str) -> Picture:
    """The thumbnail of the method `name`, 320x180 px. Those of built-in methods are rendered once on a machine.

    Raises: BadParameter if there is no such method.
    """
    method = find_method(name)
    try:
        if (session := method.stream(method.Params(), SIZE, 0, {})) is None:
            return _card(method)
        data = _kept(name, session) if name in BUILT_IN else _rendered(session)
    except (ImpastoError, OSError):  # for example without a compute device, which is not needed to list methods
        log.warning("No thumbnail of %s", name, exc_info=True)
        return _card(method)
    return Picture(data, "image/jpeg")


def _kept(name: str, session: Session) -> bytes:
    facts = (SCENE, SIZE, FRAMES, JPEG_QUALITY)
    return painted(f"thumbnail-{name}.jpg", facts, lambda: _rendered(session)).read_bytes()


def _rendered(session: Session) -> bytes:
    source = scene(SCENE, SIZE, FRAMES)
    *_, frame = (session.step(source.image(index)) for index in range(FRAMES))
    _, data = cv2.imencode(".jpg", cv2.cvtColor(frame, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    return data.tobytes()


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
