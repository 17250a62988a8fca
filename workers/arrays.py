"""Dictionaries of arrays as bytes: the npz format, without pickle, the same bytes for the same arrays.

Integers (labels, masks) shrink much for little time and are deflated; floats do not and are stored.
"""

from __future__ import annotations

import io
import zipfile
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from pipeline.methods.base import Arrays
from pipeline.video.writer import zip_entry


def write_arrays(stream: IO[bytes], arrays: Arrays) -> None:
    """Write arrays by name. Raises ValueError for arrays of Python objects."""
    with zipfile.ZipFile(stream, "w", compresslevel=1) as target:
        for name in sorted(arrays):
            array = np.asanyarray(arrays[name])
            entry = zip_entry(f"{name}.npy")
            entry.compress_type = zipfile.ZIP_STORED if array.dtype.kind in "fc" else zipfile.ZIP_DEFLATED
            with target.open(entry, "w", force_zip64=True) as member:
                np.lib.format.write_array(member, array, allow_pickle=False)


def read_arrays(data: bytes) -> dict[str, NDArray[Any]]:
    """What `write_arrays` wrote."""
    with np.load(io.BytesIO(data), allow_pickle=False) as found:
        return {name: found[name] for name in found.files}
