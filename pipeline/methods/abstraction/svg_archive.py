"""Vector output: each frame as regions with boundary and colour (zhang2011online, section 7)."""

from __future__ import annotations

import io
import zipfile

import numpy as np

from pipeline.methods.abstraction.compositor import INK, CompositedFrame
from pipeline.vector.svg import DEFAULT_PASSES, to_svg

_EPOCH = (1980, 1, 1, 0, 0, 0)


class SvgArchive:
    """Zip with one SVG per frame, named by frame number; a region has the same id in all its frames."""

    def __init__(self, key: str) -> None:
        self.name = f"svg-{key}.zip"
        self._bytes = io.BytesIO()
        self._zip = zipfile.ZipFile(self._bytes, "w", zipfile.ZIP_DEFLATED, compresslevel=6)

    def add(self, index: int, painting: CompositedFrame) -> None:
        ink = None if painting.ink is None else painting.ink.astype(np.float32) / np.float32(255)
        page = to_svg(
            painting.labels, painting.colours, painting.regions.ids, ink=ink, ink_colour=INK,
            smoothing=painting.borders or DEFAULT_PASSES, size=painting.frame.shape[1::-1],
        )  # fmt: skip
        self._zip.writestr(zipfile.ZipInfo(f"{index:05d}.svg", _EPOCH), page)

    def close(self) -> bytes:
        self._zip.close()
        return self._bytes.getvalue()
