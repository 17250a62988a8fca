"""Dictionaries of arrays as bytes: the npz format, without pickle; equal arrays give equal bytes.

Integers that repeat from pixel to pixel (labels, masks) compress well and are deflated. Other arrays (photographs,
weights, all floats) do not and are stored: they are written without a copy, and read as views of the bytes. Therefore
they begin at a multiple of `ALIGNED` bytes.
"""

from __future__ import annotations

import io
import math
import struct
import zipfile
import zlib
from functools import lru_cache
from typing import IO, Any

import numpy as np

from pipeline.arrays import AnyArray
from pipeline.methods.base import Arrays
from pipeline.video.writer import zip_entry

REPEATS = 0.9
"""Least share of elements equal to the previous one for which an array is deflated. Deflating runs at ten megabytes a
second: a photograph would shrink by a third, but take longer to pack than to compute."""
PIECES, PIECE = 16, 4096
"""Number and length of the runs of elements that are sampled to decide whether an array is deflated."""
ALIGNED = 64
"""Stored arrays begin at a multiple of this many bytes, as NumPy's own do."""
_HEADS = 512
"""Number of cached headers: hundreds of arrays have the same shape, and making a header takes longer than writing a
small array."""
_PADDING = 0xD935
"""Id of a field in an entry's header that only fills space, as `zipalign` uses it."""
_LOCAL = struct.Struct("<26xHH")
"""Part of a zip entry's local header: the lengths of its name and of its extra fields."""


def write_arrays(stream: IO[bytes], arrays: Arrays) -> None:
    """Write arrays by name. Raises ValueError for arrays of Python objects.

    Args:
        stream: can be written to and sought in.
    """
    with zipfile.ZipFile(stream, "w", compresslevel=1) as target:
        for name in sorted(arrays):
            _write(target, stream, f"{name}.npy", np.asarray(arrays[name], order="C"))


def _write(target: zipfile.ZipFile, stream: IO[bytes], name: str, array: AnyArray) -> None:
    head, entry = _head(array.shape, array.dtype), zip_entry(name)
    entry.file_size = len(head) + array.nbytes
    if _repeats(array):
        entry.compress_type = zipfile.ZIP_DEFLATED
    else:
        entry.extra = _padding(stream.tell() + _LOCAL.size + len(name))
    with target.open(entry, "w") as member:
        member.write(head)
        member.write(array.reshape(-1).view(np.uint8).data)


@lru_cache(_HEADS)
def _head(shape: tuple[int, ...], dtype: np.dtype[Any]) -> bytes:
    """Header of an npy file; its length is a multiple of `ALIGNED`."""
    if dtype.hasobject:
        raise ValueError("Object arrays cannot be stored.")
    out = io.BytesIO()
    fields = {"shape": shape, "fortran_order": False, "descr": np.lib.format.dtype_to_descr(dtype)}
    np.lib.format.write_array_header_1_0(out, fields)
    return out.getvalue()


def _padding(at: int) -> bytes:
    """A field of such a length that the position after it is a multiple of `ALIGNED`."""
    padding = -(at + 4) % ALIGNED
    return struct.pack("<HH", _PADDING, padding) + bytes(padding)


def _repeats(array: AnyArray) -> bool:
    if array.dtype.kind in "fcOV":  # rows of several fields are slow to compare
        return False
    flat = array.reshape(-1)
    starts = [0] if flat.size <= PIECES * PIECE else range(0, flat.size - PIECE, flat.size // PIECES)
    pieces = [flat] if len(starts) == 1 else [flat[start : start + PIECE] for start in starts]
    same = sum(int(np.count_nonzero(piece[1:] == piece[:-1])) for piece in pieces)
    return same >= REPEATS * sum(piece.size for piece in pieces)


def read_arrays(data: bytes) -> dict[str, AnyArray]:
    """The arrays that `write_arrays` wrote; they are writable. Raises ValueError or BadZipFile if the bytes are
    damaged."""
    whole = memoryview(bytearray(data))
    with zipfile.ZipFile(io.BytesIO(data)) as source:
        return {
            entry.filename.removesuffix(".npy"): _array(_member(source, entry, whole)) for entry in source.infolist()
        }


def _member(source: zipfile.ZipFile, entry: zipfile.ZipInfo, whole: memoryview) -> memoryview:
    """An entry's bytes; a view, not a copy, if they are stored uncompressed."""
    if entry.compress_type != zipfile.ZIP_STORED:
        return memoryview(bytearray(source.read(entry)))
    name, fields = _LOCAL.unpack_from(whole, entry.header_offset)
    start = entry.header_offset + _LOCAL.size + name + fields
    found = whole[start : start + entry.file_size]
    if len(found) != entry.file_size or zlib.crc32(found) != entry.CRC:
        raise zipfile.BadZipFile(f"{entry.filename} is damaged.")
    return found


def _array(data: memoryview) -> AnyArray:
    head = bytes(data[: 10 + int.from_bytes(data[8:10], "little")])
    shape, dtype = _announced(head)
    found = np.frombuffer(data, dtype, count=math.prod(shape), offset=len(head))
    return (found if found.flags.aligned else found.copy()).reshape(shape)


@lru_cache(_HEADS)
def _announced(head: bytes) -> tuple[tuple[int, ...], np.dtype[Any]]:
    """Shape and type of an array, from the header of its npy file."""
    stream = io.BytesIO(head)
    if np.lib.format.read_magic(stream) != (1, 0):
        raise ValueError("Arrays are stored as version 1.0 of the npy format.")
    shape, fortran, dtype = np.lib.format.read_array_header_1_0(stream)
    if dtype.hasobject or fortran:
        raise ValueError("Object arrays are not loaded, and none is stored in Fortran's order.")
    return shape, dtype
