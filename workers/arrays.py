"""Dictionaries of arrays as bytes: the npz format, without pickle, the same bytes for the same arrays.

Integers that repeat from pixel to pixel (labels, masks) shrink much for little time and are deflated; what varies
(photographs, weights, all floats) does not, and is stored.
"""

from __future__ import annotations

import io
import zipfile
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from pipeline.methods.base import Arrays
from pipeline.video.writer import zip_entry

REPEATS = 0.9
"""Part of an array's elements that equal the one before them, from which it is deflated: at ten megabytes a second a
photograph that shrinks by a third would take longer to pack than to compute."""


def write_arrays(stream: IO[bytes], arrays: Arrays) -> None:
    """Write arrays by name. Raises ValueError for arrays of Python objects."""
    with zipfile.ZipFile(stream, "w", compresslevel=1) as target:
        for name in sorted(arrays):
            array = np.asanyarray(arrays[name])
            entry = zip_entry(f"{name}.npy")
            entry.compress_type = zipfile.ZIP_DEFLATED if _repeats(array) else zipfile.ZIP_STORED
            with target.open(entry, "w", force_zip64=True) as member:
                np.lib.format.write_array(member, array, allow_pickle=False)


def _repeats(array: NDArray[Any]) -> bool:
    flat = array.ravel()
    return array.dtype.kind not in "fcO" and bool(np.count_nonzero(flat[1:] == flat[:-1]) >= REPEATS * flat.size)


def read_arrays(data: bytes) -> dict[str, NDArray[Any]]:
    """What `write_arrays` wrote."""
    with np.load(io.BytesIO(data), allow_pickle=False) as found:
        return {name: found[name] for name in found.files}
