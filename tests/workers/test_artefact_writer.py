"""Artefacts are stored on threads: contents as of the call, errors at the end, large ones at once."""

from __future__ import annotations

import threading
from pathlib import Path

import numpy as np
import pytest

from workers.blobs.base import Content
from workers.blobs.disk import DiskBlobs
from workers.execution.arrays import read_arrays
from workers.execution.artefact_writer import ArtefactWriter


class SlowBlobs(DiskBlobs):
    """Stores nothing before `may_store` is set; then `broken` fails."""

    def __init__(self, root: Path) -> None:
        super().__init__(root)
        self.may_store = threading.Event()

    def put(self, key: str, data: Content) -> None:
        assert self.may_store.wait(30)
        if key == "broken":
            raise OSError("no space left")
        super().put(key, data)


def test_what_is_stored_are_the_contents_at_the_call(home: Path) -> None:
    blobs, numbers = SlowBlobs(home / "blobs"), np.arange(1000)
    writer = ArtefactWriter(blobs)
    writer.put("one.npz", {"numbers": numbers})
    numbers[:] = 0
    blobs.may_store.set()
    writer.finish()
    np.testing.assert_array_equal(read_arrays(blobs.get("one.npz"))["numbers"], np.arange(1000))
    writer.close()


def test_an_error_of_the_store_is_raised_at_the_end(home: Path) -> None:
    blobs = SlowBlobs(home / "blobs")
    writer = ArtefactWriter(blobs)
    writer.put("broken", {"numbers": np.arange(10)})
    blobs.may_store.set()
    with pytest.raises(OSError, match="no space left"):
        writer.finish()
    writer.close()


def test_large_arrays_are_stored_at_once(home: Path) -> None:
    blobs = SlowBlobs(home / "blobs")
    blobs.may_store.set()
    writer = ArtefactWriter(blobs)
    writer.put("large.npz", {"zeros": np.zeros(17 << 20, np.uint8)})
    assert read_arrays(blobs.get("large.npz"))["zeros"].nbytes == 17 << 20
    writer.close()
