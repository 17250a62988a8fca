"""`decode_raw` and `decode_planes` for untrusted bytes, in a decoder process."""

from __future__ import annotations

import tempfile
import threading
from dataclasses import asdict
from pathlib import Path

from pipeline.arrays import AnyArray
from pipeline.errors import BadInput
from pipeline.formats.base import PlaneImage
from pipeline.video.guard.decoder_process import DecoderDied, DecoderProcess, start_decoder
from pipeline.video.guard.wire import Message
from pipeline.video.media import Limits

SHARED_BYTES = 1 << 30
"""Shared memory for all channels of an image. Pages are allocated when they are written."""


class _ThreadDecoder(threading.local):
    """A decoder process per thread, kept because a shot has thousands of pictures."""

    child: DecoderProcess | None = None

    def ask(self, task: Message) -> tuple[Message, DecoderProcess]:
        """The answer, and the process whose shared memory holds the picture."""
        try:
            return self._ask(task)
        except DecoderDied:  # possibly not the picture's fault: try once more
            return self._ask(task)

    def _ask(self, task: Message) -> tuple[Message, DecoderProcess]:
        child, self.child = self.child, None
        if child is None:
            child = start_decoder("pictures", {"limits": asdict(Limits())}, SHARED_BYTES)
        try:
            answer, _ = child.ask(task)
        except BadInput:
            self.child = child if child.alive else None
            raise
        except BaseException:
            child.close()
            raise
        self.child = child
        return answer, child


_DECODER = _ThreadDecoder()


def guarded_raw(data: bytes, name: str) -> AnyArray:
    """Like `pipeline.formats.decoding.decode_raw`, in a child process. Raises UnreadableMedia, MediaTooLarge."""
    return _decoded("raw", data, name)[1]


def guarded_planes(data: bytes, name: str) -> PlaneImage:
    """Like `pipeline.formats.decoding.decode_planes`, in a child process. Raises UnreadableMedia, MediaTooLarge."""
    answer, planes = _decoded("planes", data, name)
    width, height = answer["size"]
    found = dict(zip(map(str, answer["names"]), planes, strict=True))
    return PlaneImage((int(width), int(height)), found, float(answer["aspect"]), tuple(map(str, answer["views"])),
                      tuple(map(tuple, answer["to_709"])), dict(answer["attributes"]))  # fmt: skip


def _decoded(kind: str, data: bytes, name: str) -> tuple[Message, AnyArray]:
    with tempfile.NamedTemporaryFile() as file:
        file.write(data)
        file.flush()
        answer, child = _DECODER.ask({"kind": kind, "path": str(Path(file.name).absolute()), "name": name})
        return answer, child.array(tuple(answer["shape"]), str(answer["dtype"]))
