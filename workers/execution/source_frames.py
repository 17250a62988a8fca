"""One frame of an asset as it was uploaded: for pages in browsers that cannot play it."""

from __future__ import annotations

from pipeline.video.contact_sheet import fit
from pipeline.video.stills import encode_jpeg
from workers.blobs.base import Blobs
from workers.contract.record import Asset, asset_key
from workers.execution.decoders import Decoders, frame_at


class SourceFrames:
    """Decodes single frames. Thread-safe; decoders stay open, so that frames requested in order need no seek."""

    def __init__(self, blobs: Blobs) -> None:
        self._decoders = Decoders(blobs, idle=4)

    def close(self) -> None:
        self._decoders.close()

    def jpeg(self, asset: Asset, index: int, max_side_px: int) -> bytes:
        """Frame `index`, upright and scaled to fit, JPEG; of a shorter video, its last frame.

        Raises: BadMedia (the frame cannot be decoded), KeyError (its bytes are gone).
        """
        with self._decoders.reader(asset_key(asset.id), index) as reader:
            frame = frame_at(reader, index)
        return encode_jpeg(fit(frame, max_side_px))
