"""Arrays as bytes: what comes back, what is deflated, and that the bytes are always the same."""

from __future__ import annotations

import io
import zipfile

import numpy as np
import pytest

from workers.arrays import read_arrays, write_arrays

LABELS = np.repeat(np.arange(64, dtype=np.uint16), 100).reshape(64, 100)
NOISE = np.random.Generator(np.random.Philox(3)).integers(0, 256, (64, 100, 3), dtype=np.uint8)


def packed(**arrays: np.ndarray) -> bytes:
    stream = io.BytesIO()
    write_arrays(stream, arrays)
    return stream.getvalue()


@pytest.mark.parametrize("array", [LABELS, NOISE, NOISE / 7, np.zeros((0, 4), np.int32), np.int32([5]), LABELS > 30])
def test_arrays_come_back_as_they_were(array: np.ndarray) -> None:
    back = read_arrays(packed(one=array, two=array[::-1]))
    np.testing.assert_array_equal(back["one"], array)
    np.testing.assert_array_equal(back["two"], array[::-1])
    assert back["one"].dtype == array.dtype


def test_what_repeats_is_deflated_and_what_varies_is_stored() -> None:
    archive = zipfile.ZipFile(io.BytesIO(packed(labels=LABELS, noise=NOISE, weights=LABELS.astype(np.float32))))
    kinds = {entry.filename: entry.compress_type for entry in archive.infolist()}
    stored, deflated = zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED
    assert kinds == {"labels.npy": deflated, "noise.npy": stored, "weights.npy": stored}
    assert len(packed(labels=LABELS)) < LABELS.nbytes / 10


def test_the_same_arrays_give_the_same_bytes() -> None:
    assert packed(a=LABELS, b=NOISE) == packed(b=NOISE.copy(), a=LABELS.copy())


def test_python_objects_are_refused() -> None:
    with pytest.raises(ValueError):
        packed(a=np.array([{}, []], dtype=object))
