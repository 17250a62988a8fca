"""Publishes small pictures of a running task: its newest frame, about every two seconds."""

from __future__ import annotations

import time

from pipeline.arrays import AnyArray
from pipeline.video.contact_sheet import fit
from pipeline.video.stills import as_shown, encode_jpeg
from workers.blobs.base import Blobs

EVERY_S = 2.0
SIDE_PX = 640
"""Longest side: 360 lines of a wide picture, so that scaling and coding take little time."""
KEPT = 3
"""Number of pictures kept, so that a client can still fetch a picture that was announced to it."""


class PreviewPublisher:
    """Writes JPEGs as blobs `<prefix>-<n>.jpg`: a committed blob never changes, so each picture is a new one."""

    def __init__(self, blobs: Blobs, prefix: str) -> None:
        self._blobs = blobs
        self._prefix = prefix
        self._count = 0
        self._next = time.monotonic() + EVERY_S / 4

    def due(self) -> bool:
        """Whether enough time has passed since the last preview."""
        return time.monotonic() >= self._next

    def put(self, frame: AnyArray) -> str:
        """Store a picture of `frame`, of any type, and return its blob key. Old pictures are removed."""
        self._blobs.put(self._key(self._count), encode_jpeg(fit(as_shown(frame), SIDE_PX)))
        self._count += 1
        if self._count > KEPT:
            self._blobs.delete(self._key(self._count - 1 - KEPT))
        self._next = time.monotonic() + EVERY_S
        return self._key(self._count - 1)

    def _key(self, number: int) -> str:
        return f"{self._prefix}-{number}.jpg"
