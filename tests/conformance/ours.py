"""What Impasto finds in a file, and what a film made from it sounds like."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from pipeline.errors import BadInput
from pipeline.video.damage import damage_of
from pipeline.video.guard.files import guarded_join
from pipeline.video.guard.reader import GuardedReader
from pipeline.video.probe import probe_guarded
from pipeline.video.writer import SegmentSpec, segment_writer
from tests.conformance.facts import Colours, Facts, most_pictures
from tests.conformance.reference import heard

_GRAY = np.full((16, 16, 3), 128, np.uint8)


def by_impasto(path: Path) -> Facts:
    """Read a file as a job does; a refusal is part of the facts, any other exception is raised."""
    found, colours = Facts(), Colours()
    try:
        info = probe_guarded(path)
        if info.kind == "json":
            return Facts(refused="The file is JSON.")
        most = most_pictures(path)
        with GuardedReader(path) as reader:
            for frame in reader.read(0, most):
                colours.add(frame)
                found.pictures += 1
            tick = reader.time_base
            found.times_s = [float((t - reader.timestamps[0]) * tick) for t in reader.timestamps[: found.pictures]]
            found.size, found.notes = reader.size, [note.message for note in reader.notes]
            found.damaged = bool(damage_of(reader.index, (*reader.unreadable, *reader.index.incomplete)))
            found.colours, found.repeated = colours.sampled(), len(reader.unreadable)
            if info.has_audio:
                found.onset_s = _heard(path, reader, most)
    except BadInput as error:
        return Facts(refused=f"{error.message} {error.value or ''}".strip())
    return found


def _heard(path: Path, reader: GuardedReader, most: int) -> float | None:
    """The onset of the sound, from the first picture, of a film with gray pictures at the times of this one."""
    index, count = reader.index, min(reader.frames, most)
    with TemporaryDirectory() as folder:
        segment, whole = Path(folder) / "segment", Path(folder) / "whole.mp4"
        with segment_writer(segment, SegmentSpec("mp4", (16, 16), index.time_base, index.fps, 40)) as writer:
            for at in range(count):
                writer.write(at, _GRAY, index.time(at), index.time(at + 1))
        guarded_join([(index.time(0) * index.time_base, segment)], whole, "mp4", path)
        with GuardedReader(whole) as made:
            first_s = float(made.timestamps[0] * made.time_base)
        return heard(whole, first_s)
