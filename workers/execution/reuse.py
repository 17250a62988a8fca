"""Reuse of task results: a task whose inputs are those of the same task of an earlier job is not run again.

A task is a pure function of its order and of the data that it reads through its context. While it runs, the context
records every read and a digest of the result: whether an input is given, the frames of an image sequence, single
images, artefacts of earlier tasks. When a later job has a task of the same step and key, its worker compares the two
orders and looks up each recorded read in the new job. If nothing differs, the task would make the same bytes, and gets
the earlier result.

Source: verifying traces of Mokhov, Mitchell, Peyton Jones: Build systems a la carte (ICFP 2018), section 4.2.2.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from pipeline.arrays import AnyArray
from pipeline.errors import ImpastoError
from pipeline.methods.base import Arrays
from workers.blobs.base import Blobs
from workers.contract.order import EarlierTask, TaskOrder, TaskOutcome
from workers.contract.request import Json

ABSENT = "-"
"""Digest of something that does not exist."""
_DIGEST_BYTES = 12
PREVIEW = "preview"


def arrays_digest(arrays: Arrays) -> str:
    """Digest of names, types, shapes and values."""
    found = hashlib.blake2b(digest_size=_DIGEST_BYTES)
    for name in sorted(arrays):
        array = np.asarray(arrays[name], order="C")
        found.update(f"{name} {array.dtype.str} {array.shape};".encode())
        found.update(array.reshape(-1).view(np.uint8).data)
    return found.hexdigest()


def _digest(value: object) -> str:
    text = json.dumps(value, sort_keys=True, separators=(",", ":"), default=str)
    return hashlib.blake2b(text.encode(), digest_size=_DIGEST_BYTES).hexdigest()


def signature(order: TaskOrder, params_read: Sequence[str] | None = None) -> str:
    """Digest of the data that a task has without reading: versions of the steps up to its own, place in the plan,
    parameters, facts of the video, and encoding of emitted frames.

    Args:
        params_read: names of the parameters that it reads; None: all.
    """
    output = order.output
    params = order.params if params_read is None else {name: order.params[name] for name in params_read}
    return _digest(
        [order.versions, order.method, order.step, order.key, order.args, order.after, order.emits, params, order.seed,
         order.input_info.get("video"), output.format, output.quality,
         output.profile, output.alpha, output.colour, order.frames, order.on_damage,
         asdict(order.source)]
    )  # fmt: skip


Images = Callable[[str], Mapping[int, AnyArray]]
"""The images of an input by frame number. Raises ImpastoError if the input is not given."""


@dataclass
class ReadRecord:
    """The reads of a task so far.

    Attributes:
        order: of the task.
        images: opens an input.
        digests: read (see `current`) -> digest.
        params_read: names of the parameters that the task reads; None: all.
    """

    order: TaskOrder
    images: Images
    digests: dict[str, str]
    params_read: Sequence[str] | None = None

    def record(self, read: str, digest: str | None = None) -> None:
        """Record a read. `digest`: None: computed here."""
        if read not in self.digests:
            self.digests[read] = self.current(read) if digest is None else digest

    def current(self, read: str) -> str:
        """Digest of a read in this job: "report" (whether the result is measured), "has NAME", "input NAME" (the whole
        file), "wants ARTEFACT", "pass NAME" (whether it is requested, and its format), "artefact STEP/NAME", "numbers
        NAME" (frame numbers of an image sequence), "image NAME FRAME"."""
        kind, _, name = read.partition(" ")
        if kind == "report":
            return str(self.order.output.report)
        if kind == "has":
            return str(name in self.order.inputs)
        if kind == "input":
            return self.order.inputs.get(name, ABSENT)
        if kind == "wants":
            return str(name in self.order.output.artefacts)
        if kind == "pass":
            return f"{name in self.order.output.passes} {self.order.output.passes_format}"
        if kind == "artefact":
            return self.order.artefacts.get(name, ABSENT).rpartition("/")[2]
        if kind == "numbers":
            return _digest(sorted(self.images(name)))
        name, _, frame = name.partition(" ")
        return image_digest(self.images(name), int(frame))

    def outcome(self, outcome: TaskOutcome) -> Json | None:
        """The trace to be stored with an outcome; None if it cannot be reused: it has files of its own or warnings."""
        if outcome.warnings or outcome.fault or outcome.cancelled or outcome.files.keys() - {PREVIEW}:
            return None
        return {"signature": signature(self.order, self.params_read), "reads": self.digests}


def image_digest(images: Mapping[int, AnyArray], frame: int) -> str:
    """Digest of an image of a sequence."""
    return arrays_digest({"": images[frame]}) if frame in set(images) else ABSENT


@dataclass(frozen=True)
class RecordedImages(Mapping[int, AnyArray]):
    """The images of an input; every access is recorded."""

    name: str
    images: Mapping[int, AnyArray]
    reads: ReadRecord

    def __getitem__(self, frame: int) -> AnyArray:
        image = self.images[frame] if frame in self else None
        if image is None:
            raise KeyError(frame)
        return image

    def __contains__(self, frame: object) -> bool:
        if not isinstance(frame, int):
            return False
        self.reads.record(f"image {self.name} {frame}")
        return frame in set(self.images)

    def __iter__(self) -> Iterator[int]:
        self.reads.record(f"numbers {self.name}")
        return iter(self.images)

    def __len__(self) -> int:
        self.reads.record(f"numbers {self.name}")
        return len(self.images)


def reused(reads: ReadRecord, earlier: EarlierTask, blobs: Blobs) -> TaskOutcome | None:
    """The outcome of the same task of an earlier job if this task would give the same; None if it must run."""
    trace, order = earlier.trace, reads.order
    if trace["signature"] != signature(order, reads.params_read):
        return None
    try:
        if any(reads.current(read) != digest for read, digest in sorted(trace["reads"].items())):
            return None
    except ImpastoError:  # an input that the earlier task read is not given or cannot be read
        return None
    made = [*earlier.artefacts.values(), *([earlier.segment] if earlier.segment else [])]
    if any(blobs.size(key) is None for key in made):
        return None
    return TaskOutcome(
        order.attempt_id, earlier.result, earlier.artefacts, {}, earlier.segment, {}, "", trace=trace, reused=True
    )
