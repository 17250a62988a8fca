"""The context of a preview: the query, cached frames, and a check whether the answer is still wanted."""

from __future__ import annotations

import time
from dataclasses import dataclass

from pipeline.frames import Frame
from pipeline.video.stills import encode_jpeg, encode_png
from workers.contract.request import Json
from workers.previews.artefact_files import ArtefactFiles
from workers.previews.byte_cache import ByteCache
from workers.previews.memory import Check
from workers.previews.model import PreviewQuery, Record
from workers.previews.warm import WarmFrames

JPEG_QUALITY = 85


@dataclass(frozen=True)
class PreviewContext:
    """The context of a preview.

    Attributes:
        check: raises an error once the client has left; call it between pieces of work.
    """

    query: PreviewQuery
    frames: WarmFrames
    cache: ByteCache
    artefacts: ArtefactFiles
    check: Check
    began: float

    @property
    def options(self) -> Json:
        return self.query.options

    def picture(self, frame: int, image: Frame, *, final: bool, **more: object) -> Record:
        """A record of type "frame"."""
        jpeg = not final or self.options.get("format") == "jpeg"
        info = self.frames.info(self.query.layers[0].video)
        header = {
            "type": "frame", "frame": frame, "pass": int(final), "final": final,
            "scale": round(image.shape[1] / info.width, 4), "width": image.shape[1], "height": image.shape[0],
            "media_type": "image/jpeg" if jpeg else "image/png", "ms": self.ms, **more,
        }  # fmt: skip
        return Record(header, encode_jpeg(image, JPEG_QUALITY) if jpeg else encode_png(image))

    @property
    def ms(self) -> int:
        """Milliseconds since the query began."""
        return round((time.monotonic() - self.began) * 1000)
