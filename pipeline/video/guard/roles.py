"""The decoder server's loop, and the roles of its children: each runs one role on one file, within limits, and ends."""

from __future__ import annotations

import contextlib
import ctypes
import mmap
import os
import resource
import signal
import socket
from collections.abc import Callable, Iterator
from fractions import Fraction
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
import psutil

from pipeline.arrays import AnyArray
from pipeline.errors import BadInput, Cancelled, MediaTooLarge
from pipeline.formats.base import Encoding
from pipeline.formats.decoding import decode_planes, decode_raw
from pipeline.kernels.allocator import keep_freed_memory, limit_arenas
from pipeline.perception.cuts import thumbnail
from pipeline.video.guard.wire import ConnectionBroken, Message, receive, send
from pipeline.video.join import join
from pipeline.video.media import Limits, SourceOptions
from pipeline.video.numbered import NumberedImages
from pipeline.video.numbering import runs_of_numbers
from pipeline.video.probe import probe
from pipeline.video.reader import VideoReader

_PR_SET_PDEATHSIG, _PR_SET_NO_NEW_PRIVS = 1, 38
_KEPT_BYTES = 64 << 20
"""Freed memory that a child keeps for its next frames, bytes."""
_OPEN_FILES = 64


class ChildConnection:
    """A child's end of the connection: requests, answers, and the shared memory for arrays."""

    def __init__(self, wire: socket.socket, shared: mmap.mmap) -> None:
        self._wire, self._shared = wire, shared

    def next(self) -> Message:
        """The next request."""
        return receive(self._wire)[0]

    def answer(self, message: Message, data: bytes = b"") -> None:
        send(self._wire, message, data)

    def share(self, array: AnyArray) -> Message:
        """Copy an array into the shared memory; the answer that describes it."""
        if array.nbytes > len(self._shared):
            raise MediaTooLarge(
                "The picture has too many pixels.", field="file", value=array.shape, remedy="Scale it down."
            )
        np.frombuffer(self._shared, array.dtype, array.size).reshape(array.shape)[...] = array
        return {"shape": array.shape, "dtype": array.dtype.str}


def _limits(task: Message) -> Limits:
    return Limits(**task["limits"])


def _options(task: Message) -> SourceOptions:
    return SourceOptions.from_json(task.get("options"))


def _video(connection: ChildConnection) -> None:
    """A `VideoReader`: {"start", "stop"} begins a read, {} gives its next frame; with {"thumbnails": n}, thumbnails of
    the next n frames in one array.

    While the parent works on a frame, the next one of the same read is decoded.
    """
    task = connection.next()
    with VideoReader(Path(task["path"]), _limits(task), _options(task)) as reader:
        index = reader.index
        tick = index.time_base
        facts = {"size": reader.size, "rotation_deg": reader.rotation_deg, "pixel_format": reader.pixel_format}
        facts["alpha"] = reader.has_alpha
        times = {"tick": (tick.numerator, tick.denominator), "end": index.end, "exact": index.exact}
        times |= {"missing": index.missing, "incomplete": sorted(index.incomplete)}
        times |= {"notes": reader.notes, "numbers": runs_of_numbers(index.numbers)}
        data = index.pts.astype("<i8").tobytes() + index.keys.astype("<i8").tobytes()
        connection.answer(facts | times | {"frames": len(index.pts), "position": reader.position}, data)
        faults, frames = _Faults(reader), reader.read(0, 0)
        ahead: _Read | None = None
        while True:
            request = connection.next()
            if "start" in request:
                frames, ahead = reader.read(request["start"], request["stop"]), None
            if "thumbnails" in request:
                found = [thumbnail(frame) for frame in islice(frames, request["thumbnails"])]
                state = faults.new(reader.position, len(reader.errors), len(reader.unreadable))
                connection.answer(state | (connection.share(np.stack(found)) if found else {"end": True}))
                continue
            now = ahead or _read_next(reader, frames)
            state = faults.new(now.position, now.errors, now.unreadable)
            connection.answer(state | ({"end": True} if now.frame is None else connection.share(now.frame)))
            ahead = None if now.frame is None else _read_next(reader, frames)


class _Faults:
    """Errors and unreadable frames of a reader; each answer reports those found since the answer before."""

    def __init__(self, reader: VideoReader) -> None:
        self._reader, self._reported, self._noted = reader, 0, 0

    def new(self, position: int | None, errors: int, unreadable: int) -> Message:
        """The reader's position, and its findings from those of the last call up to these numbers of them."""
        found: Message = {"position": position, "errors": self._reader.errors[self._reported : errors]}
        found["unreadable"] = self._reader.unreadable[self._noted : unreadable]
        self._reported, self._noted = errors, unreadable
        return found


class _Read(NamedTuple):
    """A frame, or None after the last one; and the reader's state when the frame had been read."""

    frame: AnyArray | None
    position: int | None
    errors: int
    unreadable: int


def _read_next(reader: VideoReader, frames: Iterator[AnyArray]) -> _Read:
    frame = next(frames, None)
    return _Read(frame, reader.position, len(reader.errors), len(reader.unreadable))


def _probe(connection: ChildConnection) -> None:
    task = connection.next()
    connection.answer({"info": probe(Path(task["path"]), _limits(task), _options(task)).as_json()})


def _images(connection: ChildConnection) -> None:
    """A `NumberedImages`: {"number"} returns an image."""
    task = connection.next()
    found = NumberedImages(Path(task["path"]), task["field"], _limits(task))
    connection.answer({"numbers": list(found), "single": found.is_single})
    while True:
        connection.answer(connection.share(found[connection.next()["number"]]))


def _pictures(connection: ChildConnection) -> None:
    """One encoded picture after another: {"kind", "path", "name"} gives it as displayed, or all its named planes."""
    limits = _limits(connection.next())
    connection.answer({})
    while True:
        task = connection.next()
        path, name = Path(task["path"]), str(task["name"])
        try:
            if task["kind"] == "raw":
                connection.answer(connection.share(decode_raw(path.read_bytes(), limits, name)))
            else:
                image = decode_planes(path.read_bytes(), limits, name)
                shared = connection.share(np.stack(list(image.planes.values())))
                facts = {"size": image.size, "aspect": image.pixel_aspect, "views": image.views}
                facts |= {"to_709": image.to_709, "attributes": dict(image.attributes)}
                connection.answer(shared | facts | {"names": list(image.planes)})
        except BadInput as error:  # only this picture is bad; the next one may be sound
            connection.answer({"error": _described(error)})


def _join(connection: ChildConnection) -> None:
    task = connection.next()
    segments = [(Fraction(above, below), Path(path)) for above, below, path in task["segments"]]
    sound = Path(task["sound"]) if task["sound"] else None
    end_s = Fraction(*task["end"]) if task["end"] else None

    def report_progress(done: float) -> None:
        connection.answer({"progress": done})

    encoding = Encoding(task["format"], int(task["quality"]))
    notes = join(segments, Path(task["out"]), encoding, sound, report_progress, end_s, _options(task))
    connection.answer({"notes": notes})


ROLES: dict[str, Callable[[ChildConnection], None]] = {
    "video": _video,
    "probe": _probe,
    "images": _images,
    "pictures": _pictures,
    "join": _join,
}
_WRITERS = frozenset({"join"})
"""Roles that may write files."""


def _run_role(wire: socket.socket, shared_fd: int) -> None:
    """Run one role, from the first message to the end of the process."""
    first, _ = receive(wire)
    _set_limits(first)
    connection = ChildConnection(wire, mmap.mmap(shared_fd, int(first["shared"])))
    connection.answer({"pid": os.getpid()})
    try:
        ROLES[first["role"]](connection)
    except (ConnectionBroken, ConnectionError):
        return
    except BaseException as error:
        connection.answer({"error": _described(error)})


def _described(error: BaseException) -> Message:
    if isinstance(error, BadInput):
        named = {"field": error.field, "value": error.value, "remedy": error.remedy}
        return {"kind": type(error).__name__, "message": error.message, **named}
    if isinstance(error, MemoryError | cv2.error):
        remedy = "Re-encode it as H.264 in MP4."
        message = "The file crashes the decoder, or needs too much memory."
        return {"kind": "UnreadableMedia", "message": message, "field": "file", "remedy": remedy}
    if isinstance(error, OSError) and not isinstance(error, Cancelled):
        return {"errno": error.errno or 5, "message": error.strerror or str(error)}
    return {"message": f"{type(error).__name__}: {error}"[:500]}


def _set_limits(first: Message) -> None:
    """Limit memory and open files; forbid core dumps and, for most roles, writing files."""
    memory = psutil.Process().memory_info().vms + int(first["memory"])
    allowed = resource.getrlimit(resource.RLIMIT_AS)[1]  # of the machine's operator (`ulimit -v`): cannot be raised
    memory = memory if allowed == resource.RLIM_INFINITY else min(memory, allowed)
    resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_NOFILE, (_OPEN_FILES, _OPEN_FILES))
    if first["role"] == "probe":
        seconds = int(first["seconds"]) + 1
        resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))
    if first["role"] not in _WRITERS:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))


def serve(control: socket.socket) -> None:
    """Fork a child for every request, until the process that started the server has ended."""
    libc = ctypes.CDLL(None)
    limit_arenas(2)
    keep_freed_memory(_KEPT_BYTES)
    cv2.setNumThreads(1)
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # children are not waited for
    mine = os.getpid()
    while True:
        data, fds, _flags, _from = socket.recv_fds(control, 1, 2)
        if not data:
            return
        if os.fork() == 0:
            with contextlib.suppress(AttributeError):  # Linux has it
                libc.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
                libc.prctl(_PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0)
            if os.getppid() == mine:
                control.close()
                signal.signal(signal.SIGCHLD, signal.SIG_DFL)
                with contextlib.suppress(ConnectionBroken, OSError):
                    _run_role(socket.socket(fileno=fds[0]), fds[1])
            os._exit(0)
        for fd in fds:
            os.close(fd)
