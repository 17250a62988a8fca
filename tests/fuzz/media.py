"""Mutated media files: each is probed and decoded in the guarded child, as an upload is."""

from __future__ import annotations

import traceback
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from pipeline.errors import BadInput
from pipeline.formats.decoding import decode_raw
from pipeline.formats.exr import EXR
from pipeline.video.guard.files import guarded_join
from pipeline.video.guard.pictures import guarded_planes, guarded_raw
from pipeline.video.guard.reader import GuardedReader
from pipeline.video.media import Limits, MediaInfo
from pipeline.video.probe import probe, probe_guarded
from pipeline.video.reader import VideoReader
from pipeline.video.writer import SegmentSpec, segment_writer
from tests.fuzz.mutate import mutated
from tests.fuzz.samples import samples

LIMITS = Limits(size_bytes=1 << 22, pixels=1 << 20, side_px=2048, seconds=600, frames=2000)
MOST_FRAMES = 50
SLOW_S = 30.0
"""A case that takes longer counts as a hang."""


@dataclass(frozen=True)
class Case:
    """One malformed file, reproducible from its kind, seed and number."""

    kind: str
    seed: int
    number: int

    @property
    def id(self) -> str:
        return f"media:{self.kind}:{self.seed}:{self.number}"

    @classmethod
    def of(cls, name: str) -> Case:
        """The case of an id."""
        _, kind, seed, number = name.split(":")
        return cls(kind, int(seed), int(number))

    def data(self) -> bytes:
        """The file's bytes."""
        files, every = samples()[self.kind], _every()
        other = every[(self.number * 7 + self.seed) % len(every)]
        return mutated(files[self.number % len(files)], other, self.seed, self.number)


@cache
def _every() -> tuple[bytes, ...]:
    return tuple(data for files in samples().values() for data in files)


def cases(seed: int, number: int) -> list[Case]:
    """One case of each kind."""
    return [Case(kind, seed, number) for kind in samples()]


def _joined(path: Path) -> None:
    with TemporaryDirectory(prefix="impasto-fuzz-") as folder:
        segment = Path(folder) / "segment"
        with segment_writer(segment, SegmentSpec("mp4", (16, 16), Fraction(1, 25), 25.0, 40)) as writer:
            for at in range(3):
                writer.write(at, np.zeros((16, 16, 3), np.uint8), at, at + 1)
        guarded_join([(Fraction(0), segment)], Path(folder) / "whole.mp4", "mp4", path)


@dataclass(frozen=True)
class Decoders:
    """The decoders of uploads."""

    probe: Callable[[Path, Limits], MediaInfo]
    reader: Callable[[Path, Limits], GuardedReader | VideoReader]
    raw: Callable[[bytes, Path], object]
    exr: Callable[[bytes, Path], object]
    join: Callable[[Path], object] = _joined
    """Makes a film with the sound of a file, and with what else it carries."""


GUARDED = Decoders(
    probe_guarded, GuardedReader, lambda data, path: guarded_raw(data, "image"),
    lambda data, path: guarded_planes(data, "image"),
)  # fmt: skip
"""Decodes each file in a separate decoder process, as the service does."""
DIRECT = Decoders(
    probe, VideoReader, lambda data, path: decode_raw(data, Limits(), "image"),
    lambda data, path: EXR.planes(path, Limits(), "image"), lambda path: None,
)  # fmt: skip
"""Decodes in this process."""


def outcome(case: Case, folder: Path) -> str:
    """The outcome of a case: "decoded", "refused: REASON", or "fault: ERROR" for any exception except a refusal."""
    path = folder / "upload"
    path.write_bytes(data := case.data())
    try:
        return run(case.kind, path, data)
    except Exception as error:
        return fault(error)


def fault(error: Exception) -> str:
    """The outcome of a case that ended with this exception."""
    where = traceback.extract_tb(error.__traceback__)[-1]
    return f"fault: {type(error).__name__}: {error} ({Path(where.filename).name}:{where.lineno})"


def run(kind: str, path: Path, data: bytes, decoders: Decoders = GUARDED) -> str:
    """Decode a file: "decoded", or "refused: why".

    Raises:
        AssertionError: a refusal without a remedy, or a frame of a size that was not announced.
    """
    try:
        return decode(kind, path, data, decoders)
    except BadInput as error:
        assert error.remedy, f"no remedy: {error}"
        return f"refused: {error.message}"


def decode(kind: str, path: Path, data: bytes, decoders: Decoders = GUARDED) -> str:
    """Probe and decode a file of `kind` at `path`, of which `data` are the bytes. Raises what the decoders raise."""
    if kind == "exr":
        decoders.exr(data, path)
        return "decoded"
    info = decoders.probe(path, LIMITS)
    if info.kind in ("video", "image"):
        with decoders.reader(path, LIMITS) as reader:
            for frame in reader.read(0, MOST_FRAMES):
                assert frame.shape == (info.height, info.width, 3), "a frame of another size than announced"
        if info.kind == "video" and kind not in ("gif", "zip", "shot"):
            decoders.join(path)
    if info.kind == "image":
        decoders.raw(data, path)
    return "decoded"
