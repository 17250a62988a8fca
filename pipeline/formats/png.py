"""PNG and animated PNG; films as zips or folders of numbered PNG frames."""

from __future__ import annotations

import cv2
import numpy as np

from pipeline.arrays import AnyArray
from pipeline.formats.base import Carries, Choice, OutputFormat, Profile
from pipeline.formats.pillow import PillowFormat, faults
from pipeline.video.depth import as_uint8, as_uint16
from pipeline.video.media import Limits, unreadable
from pipeline.video.stills import encode_png

_BIT_DEPTH, _COLOUR_TYPE = 24, 25
"""Places of these bytes in a file."""
_RGB, _ALPHA = 2, 4
"""Colour type of true colour, and its flag of opacity."""


class Png(PillowFormat):
    name, title, media_type, plugin = "png", "PNG", "image/png", "PNG"
    suffixes = (".png", ".apng")
    magic = (b"\x89PNG\r\n\x1a\n",)
    carries = Carries(alpha=True, depth_bits=16, animation=True)

    def read(self, data: bytes, limits: Limits, name: str, choice: Choice = Choice()) -> AnyArray:
        """Like `PillowFormat.read`, which reduces colours of 16 bits to 8; with `choice.deep` they are uint16, unless a
        profile must be applied to them."""
        if not choice.deep or (data[_BIT_DEPTH], data[_COLOUR_TYPE] & ~_ALPHA) != (16, _RGB) or b"iCCP" in data[:4096]:
            return super().read(data, limits, name, choice)
        with faults("The image cannot be decoded", name):
            stored = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
        if stored is None:
            unreadable("The image cannot be decoded.", name)
        return np.asarray(cv2.cvtColor(stored, cv2.COLOR_BGRA2RGBA if stored.shape[2] == 4 else cv2.COLOR_BGR2RGB))

    def end_of(self, data: bytes) -> int:
        at = 8
        while at + 8 <= len(data):
            kind, at = data[at + 4 : at + 8], at + 12 + int.from_bytes(data[at : at + 4])
            if kind == b"IEND":
                return at
        return len(data)


PNG = Png()


PNG_FRAMES = OutputFormat(
    name="png", title="PNG frames", help="The film's frames as lossless pictures, in a zip",
    media_type="application/zip", suffixes=(".zip",), frame_suffixes=(".png",), shown_as="sheet",
    profiles=(
        Profile(
            name="8", title="8 bit", has_quality=False, low_bytes_per_pixel=0.3, bytes_per_pixel=1.5,
            encode=lambda picture, _: encode_png(as_uint8(picture)),
        ),
        Profile(
            name="16", title="16 bit", depth_bits=16, has_quality=False, low_bytes_per_pixel=0.6, bytes_per_pixel=4,
            encode=lambda picture, _: encode_png(as_uint16(picture)),
        ),
    ),
)  # fmt: skip
