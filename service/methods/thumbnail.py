"""A picture for a method: flat regions with bold lines, in colours that follow from its name."""

from __future__ import annotations

from html import escape
from zlib import crc32

from pipeline.methods.base import Method


def thumbnail(method: Method) -> bytes:
    """An SVG of 320x180: hills, a sun, and the method's title."""
    hue = crc32(method.name.encode()) % 360
    shapes = "".join(
        f'<path d="{path}" fill="hsl({(hue + turn) % 360} {saturation}% {light}%)" stroke="#221a2e" stroke-width="3"/>'
        for path, turn, saturation, light in _SCENE
    )
    return (
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 320 180" role="img">'
        f"<title>{escape(method.title)}</title>{shapes}</svg>"
    ).encode()


_SCENE = (
    ("M-5-5h330v190h-330z", 200, 60, 82),
    ("M230 30a28 28 0 1 0 .1 0z", 40, 85, 65),
    ("M-5 120q60-70 130-20t110-10 90 20v80h-330z", 150, 40, 62),
    ("M-5 150q80-50 160-15t170-10v60h-330z", 110, 45, 48),
    ("M90 175v-60l30-25 30 25v60z", 10, 60, 58),
    ("M82 118l38-34 38 34z", 350, 55, 42),
)
