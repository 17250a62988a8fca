"""Renders a case in memory and reduces the result to SHA-256 values. The only file here that knows the method API."""

from __future__ import annotations

import hashlib
import io
import zipfile
from collections.abc import Mapping, Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.methods import method, parse_params
from pipeline.methods.local import LocalContext, run_plan
from tests.regression.cases import Case
from tests.regression.clips import CLIPS

Digests = dict[str, str]
"""Name -> SHA-256 in hexadecimal: `frames` for all RGB frames, `file NAME` for each artefact."""


def render(case: Case) -> Digests:
    """Render a case; the digests of its frames and of its artefacts."""
    chosen = method(case.method)
    frames = list(CLIPS[case.clip]())
    context = LocalContext(parse_params(chosen, case.params), frames, case.inputs(), seed=5, artefacts=case.artefacts)
    run_plan(chosen, context)
    assert sorted(context.emitted) == list(range(len(frames))), "each frame is emitted once"
    found = {"frames": of_arrays([context.emitted[index] for index in range(len(frames))])}
    return found | {f"file {name}": of_file(data) for name, data in sorted(context.files.items())}


def clip_digests() -> Digests:
    """Digests of the clips themselves; if these change, every case does."""
    return {name: of_arrays(make()) for name, make in CLIPS.items()}


def of_arrays(arrays: Sequence[NDArray[Any]]) -> str:
    """SHA-256 over shape, type and bytes of arrays."""
    digest = hashlib.sha256()
    for array in arrays:
        digest.update(f"{array.shape}{array.dtype.str}".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def of_file(data: bytes) -> str:
    """SHA-256 of a file's contents: entries of a zip and pixels of a PNG, so that compression does not count."""
    if data.startswith(b"PK"):
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            entries = {name: of_file(archive.read(name)) for name in archive.namelist()}
        return _of_names(entries)
    if data.startswith(b"\x89PNG"):
        pixels = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
        assert pixels is not None, "a PNG that OpenCV cannot decode"
        return of_arrays([pixels])
    return hashlib.sha256(data).hexdigest()


def _of_names(entries: Mapping[str, str]) -> str:
    return hashlib.sha256("\n".join(f"{name} {entries[name]}" for name in sorted(entries)).encode()).hexdigest()
