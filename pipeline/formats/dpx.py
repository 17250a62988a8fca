"""DPX (SMPTE 268M), 8 to 16 bits, by FFmpeg. Values are taken as display-referred: film scans in log stay flat."""

from __future__ import annotations

import io
import struct
from typing import BinaryIO

import av
import numpy as np

from pipeline.arrays import AnyArray
from pipeline.formats.base import Carries, Choice, ImageFormat, ImageHeader, aspect_notes, square_pixels
from pipeline.formats.pillow import faults
from pipeline.video.media import Limits, check_size

_ORDERS = {b"SDPX": ">", b"XPDS": "<"}
_SIZE_AT, _TRANSFER_AT, _ASPECT_AT = 772, 801, 1628
_UNSET = 0xFFFFFFFF


class Dpx(ImageFormat):
    name, title, media_type, suffixes = "dpx", "DPX", "image/x-dpx", (".dpx",)
    carries = Carries(alpha=True, depth_bits=16)

    def sniff(self, head: bytes) -> bool:
        return head[:4] in _ORDERS

    def header(self, stream: BinaryIO) -> ImageHeader:
        with faults("The image's header cannot be read", "image"):
            head = stream.read(2048)
            width, height = struct.unpack_from(f"{_ORDERS[head[:4]]}II", head, _SIZE_AT)
        return ImageHeader(self.media_type, width, height)

    def notes(self, data: bytes, choice: Choice = Choice()) -> tuple[str, ...]:
        log = data[_TRANSFER_AT : _TRANSFER_AT + 1] in (b"\1", b"\3")
        found = ["The DPX is logarithmic: its values are read as they are, without a film curve."] if log else []
        return (*found, *aspect_notes(_aspect(data)))

    def read(self, data: bytes, limits: Limits, name: str, choice: Choice = Choice()) -> AnyArray:
        found = self.header(io.BytesIO(data))
        check_size(found.width, found.height, limits, f"The image {name}")
        options = {"max_pixels": str(2 * limits.pixels)}
        with (
            faults("The image cannot be decoded", name),
            av.open(io.BytesIO(data), "r", format="dpx_pipe", options=options) as container,
        ):
            picture = next(container.decode(video=0))
            alpha = any(component.is_alpha for component in picture.format.components)
            pixels = np.asarray(picture.to_ndarray(format="rgba64le" if alpha else "rgb48le"), np.uint16)
            return square_pixels(pixels, _aspect(data))


def _aspect(data: bytes) -> float:
    """Width : height of a pixel; 1 if the header does not give it."""
    if len(data) < _ASPECT_AT + 8:
        return 1.0
    across, down = struct.unpack_from(f"{_ORDERS[data[:4]]}II", data, _ASPECT_AT)
    return across / down if across not in (0, _UNSET) and down not in (0, _UNSET) else 1.0


DPX = Dpx()
