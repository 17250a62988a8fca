"""The other side: the nursery's loop, and what its children do."""

from __future__ import annotations

import contextlib
import ctypes
import gc
import mmap
import os
import resource
import signal
import socket
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import psutil
from numpy.typing import NDArray

from pipeline.errors import BadInput, Cancelled, MediaTooLarge
from pipeline.video.exr import read_exr
from pipeline.video.guard.wire import Broken, Message, receive, send
from pipeline.video.join import join
from pipeline.video.media import Limits
from pipeline.video.numbered import NumberedImages
from pipeline.video.probe import probe
from pipeline.video.reader import VideoReader
from pipeline.video.stills import decode_raw

_PR_SET_PDEATHSIG, _PR_SET_NO_NEW_PRIVS = 1, 38
_M_ARENA_MAX = -8
_OPEN_FILES = 64


class Desk:
    """A child's end: what it is asked, what it answers, where it leaves arrays."""

    def __init__(self, wire: socket.socket, shared: mmap.mmap) -> None:
        self._wire, self._shared = wire, shared

    def next(self) -> Message:
        """What we are asked next."""
        return receive(self._wire)[0]

    def say(self, message: Message, data: bytes = b"") -> None:
        send(self._wire, message, data)

    def leave(self, array: NDArray[Any]) -> Message:
        """Put an array where the other side sees it; what to say of it."""
        if array.nbytes > len(self._shared):
            raise MediaTooLarge(
                "The picture has too many pixels.", field="file", value=array.shape, remedy="Scale it down."
            )
        np.frombuffer(self._shared, array.dtype, array.size).reshape(array.shape)[...] = array
        return {"shape": array.shape, "dtype": array.dtype.str}


def _limits(task: Message) -> Limits:
    return Limits(**task["limits"])


def _video(desk: Desk) -> None:
    """A `VideoReader`: {"start", "stop"} begins a read, {} gives its next frame."""
    task = desk.next()
    with VideoReader(Path(task["path"]), _limits(task)) as reader:
        index = reader.index
        tick = index.time_base
        about = {"size": reader.size, "rotation_deg": reader.rotation_deg, "pixel_format": reader.pixel_format}
        times = {"tick": (tick.numerator, tick.denominator), "end": index.end, "exact": index.exact}
        data = index.pts.astype("<i8").tobytes() + index.keys.astype("<i8").tobytes()
        desk.say(about | times | {"frames": len(index.pts), "position": reader.position}, data)
        told, frames = 0, reader.read(0, 0)
        while True:
            asked = desk.next()
            if "start" in asked:
                frames = reader.read(asked["start"], asked["stop"])
            frame = next(frames, None)
            news: Message = {"position": reader.position, "errors": reader.errors[told:]}
            told = len(reader.errors)
            desk.say(news | ({"end": True} if frame is None else desk.leave(frame)))


def _probe(desk: Desk) -> None:
    task = desk.next()
    desk.say({"info": probe(Path(task["path"]), _limits(task)).as_json()})


def _images(desk: Desk) -> None:
    """A `NumberedImages`: {"number"} gives one."""
    task = desk.next()
    found = NumberedImages(Path(task["path"]), task["field"], _limits(task))
    desk.say({"numbers": list(found)})
    while True:
        desk.say(desk.leave(found[desk.next()["number"]]))


def _pictures(desk: Desk) -> None:
    """One encoded picture after another: {"kind", "path", "name"} gives it as stored, or every plane of an EXR."""
    limits = _limits(desk.next())
    desk.say({})
    while True:
        task = desk.next()
        path, name = Path(task["path"]), str(task["name"])
        try:
            if task["kind"] == "raw":
                desk.say(desk.leave(decode_raw(path.read_bytes(), limits, name)))
            else:
                image = read_exr(path, limits, name)
                left = desk.leave(np.stack(list(image.planes.values())))
                desk.say(left | {"size": image.size, "names": list(image.planes)})
        except BadInput as error:  # of this picture: the next one may be sound
            desk.say({"error": _described(error)})


def _join(desk: Desk) -> None:
    task = desk.next()
    segments = [(Fraction(above, below), Path(path)) for above, below, path in task["segments"]]
    sound = Path(task["sound"]) if task["sound"] else None
    join(segments, Path(task["out"]), task["format"], sound, lambda done: desk.say({"news": done}))
    desk.say({})


ROLES: dict[str, Callable[[Desk], None]] = {
    "video": _video,
    "probe": _probe,
    "images": _images,
    "pictures": _pictures,
    "join": _join,
}
_WRITERS = frozenset({"join"})
"""Roles that make files; no other writes a byte."""


def _serve(wire: socket.socket, shared_fd: int) -> None:
    """A child's whole life."""
    first, _ = receive(wire)
    _bound(first)
    desk = Desk(wire, mmap.mmap(shared_fd, int(first["shared"])))
    desk.say({"pid": os.getpid()})
    try:
        ROLES[first["role"]](desk)
    except (Broken, ConnectionError):
        return
    except BaseException as error:
        desk.say({"error": _described(error)})


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


def _bound(first: Message) -> None:
    """No more memory than allowed, no core, no new rights, and, for most, no file."""
    memory = psutil.Process().memory_info().vms + int(first["memory"])
    resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_NOFILE, (_OPEN_FILES, _OPEN_FILES))
    if first["role"] == "probe":
        seconds = int(first["seconds"]) + 1
        resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))
    if first["role"] not in _WRITERS:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))


def nursery(control: socket.socket) -> None:
    """Fork a child for every request, until whoever started us has gone."""
    libc = ctypes.CDLL(None)
    with contextlib.suppress(AttributeError):
        libc.mallopt(_M_ARENA_MAX, 2)
    cv2.setNumThreads(1)
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # children are not waited for
    mine = os.getpid()
    gc.freeze()
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
                with contextlib.suppress(Broken, OSError):
                    _serve(socket.socket(fileno=fds[0]), fds[1])
            os._exit(0)
        for fd in fds:
            os.close(fd)
