"""One frame of an asset as it was uploaded: for pages in browsers that cannot play it."""

from __future__ import annotations

from pipeline.video.contact import fit
from pipeline.video.stills import encode_jpeg
from workers.blobs.base import Blobs
from workers.decoders import Decoders
from workers.model import Asset
from workers.orders import asset_key


class Originals:
    """Decodes single frames. Thread-safe; decoders stay open, so that frames asked for in order cost no seek."""

    def __init__(self, blobs: Blobs) -> None:
        self._decoders = Decoders(blobs, idle=4)

    def close(self) -> None:
        self._decoders.close()

    def jpeg(self, asset: Asset, index: int, max_side_px: int) -> bytes:
        """Frame `index`, upright and scaled to fit, JPEG; of a shorter video, its last frame.

        Raises: BadMedia (it has no frames), KeyError (its bytes are gone).
        """
        with self._decoders.reader(asset_key(asset.id), index) as reader:
            at = min(max(index, 0), reader.frames - 1)
            frame = next(iter(reader.read(at, at + 1)))
        return encode_jpeg(fit(frame, max_side_px))
