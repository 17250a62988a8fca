"""Serialised arrays: round trips, compression, and reproducible bytes."""

from __future__ import annotations

import io
import zipfile

import numpy as np
import pytest

from workers.execution.arrays import read_arrays, write_arrays

LABELS = np.repeat(np.arange(64, dtype=np.uint16), 100).reshape(64, 100)
NOISE = np.random.Generator(np.random.Philox(3)).integers(0, 256, (64, 100, 3), dtype=np.uint8)


def packed(**arrays: np.ndarray) -> bytes:
    stream = io.BytesIO()
    write_arrays(stream, arrays)
    return stream.getvalue()


@pytest.mark.parametrize("array", [LABELS, NOISE, NOISE / 7, np.zeros((0, 4), np.int32), np.int32([5]), LABELS > 30])
def test_arrays_round_trip_unchanged(array: np.ndarray) -> None:
    back = read_arrays(packed(one=array, two=array[::-1]))
    np.testing.assert_array_equal(back["one"], array)
    np.testing.assert_array_equal(back["two"], array[::-1])
    assert back["one"].dtype == array.dtype


def test_repetitive_arrays_are_deflated_and_noisy_arrays_are_stored() -> None:
    archive = zipfile.ZipFile(io.BytesIO(packed(labels=LABELS, noise=NOISE, weights=LABELS.astype(np.float32))))
    kinds = {entry.filename: entry.compress_type for entry in archive.infolist()}
    stored, deflated = zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED
    assert kinds == {"labels.npy": deflated, "noise.npy": stored, "weights.npy": stored}
    assert len(packed(labels=LABELS)) < LABELS.nbytes / 10


def test_stored_arrays_are_read_without_copy_and_are_writable() -> None:
    data = packed(a=NOISE / 7, bb=NOISE, c=np.float64(3.5))
    at = {name: array.__array_interface__["data"][0] for name, array in read_arrays(data).items()}
    assert len({address % 64 for address in at.values()}) == 1, "each begins at a multiple of 64 bytes of the file"
    back = read_arrays(data)
    back["bb"] += 1
    assert back["c"].shape == () and read_arrays(data)["bb"][0, 0, 0] == NOISE[0, 0, 0]
    with np.load(io.BytesIO(data)) as others:
        np.testing.assert_array_equal(others["a"], NOISE / 7)


def test_corrupted_archives_are_refused() -> None:
    data = bytearray(packed(noise=NOISE))
    data[len(data) // 2] ^= 1
    with pytest.raises(zipfile.BadZipFile, match="damaged"):
        read_arrays(bytes(data))


def test_compression_of_a_large_array_is_decided_from_samples() -> None:
    large = np.repeat(np.arange(3000, dtype=np.int32), 100)
    assert len(packed(large=large)) < large.nbytes / 10
    assert len(packed(large=np.tile(NOISE.reshape(-1), 8))) > 8 * NOISE.size


def test_the_same_arrays_give_the_same_bytes() -> None:
    assert packed(a=LABELS, b=NOISE) == packed(b=NOISE.copy(), a=LABELS.copy())


def test_python_objects_are_refused() -> None:
    with pytest.raises(ValueError):
        packed(a=np.array([{}, []], dtype=object))
