"""Viewers of a live session: painted frames and sound are also sent to them. A slow viewer delays nobody else."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from service.live.frames import Header
from workers.live.codecs import BUILT_ON
from workers.live.stream import Stream

MAX_WAITING = 30
"""Maximum number of frames of a video codec that wait for a viewer. Beyond it, the viewer continues at the next key
frame."""


MAX_WAITING_SOUND = 100
"""Maximum number of packets of sound that wait for a viewer: two seconds. Beyond it, the oldest is dropped."""


@dataclass(frozen=True)
class ViewFormat:
    """Encoding of a session's frames for viewers."""

    codec: str
    size: tuple[int, int]
    """(width, height) of the client's frames, px; each frame has its own size."""
    fps: float


@dataclass(frozen=True)
class ViewedFrame:
    """A painted frame, encoded."""

    header: Header
    payload: bytes


@dataclass(frozen=True)
class ViewedSound:
    """A packet of the client's sound."""

    message: bytes
    """The binary message of the client, unchanged, with its header."""


ViewItem = ViewFormat | ViewedFrame | ViewedSound


class Viewer:
    """The frames for one viewer. For one event loop only.

    Args:
        sound: whether the viewer gets the sound, too.
    """

    def __init__(self, of: Viewers, sound: bool = False) -> None:
        self._of = of
        self.sound = sound
        self._items: deque[ViewItem] = deque()
        self._news = asyncio.Event()
        self._ended = False
        self._waits_for_key = True

    async def next(self) -> ViewItem | None:
        """The next item; a format precedes the first frame in it. None at the end of the session."""
        while not self._items and not self._ended:
            self._news.clear()
            await self._news.wait()
        return self._items.popleft() if self._items else None

    def request_key(self) -> None:
        """Ask for a key frame, because the viewer cannot decode the following frames."""
        self._of.key_wanted = True

    def put(self, item: ViewItem) -> None:
        if isinstance(item, ViewFormat):
            self._items.clear()
            self._waits_for_key = True
        elif isinstance(item, ViewedSound):
            self._forget_sound()
        elif not self._accepts(item):
            return
        self._items.append(item)
        self._news.set()

    def _accepts(self, frame: ViewedFrame) -> bool:
        """Drop waiting frames if there are too many; False if the next frame cannot be decoded without a dropped
        one."""
        waiting = [item for item in self._items if isinstance(item, ViewedFrame)]
        overfull = len(waiting) >= (MAX_WAITING if self._of.built_on else 1)
        if frame.header.key:
            if overfull:
                self._forget(waiting)
            self._waits_for_key = False
            return True
        if overfull:
            self._forget(waiting)
            self._waits_for_key = True
        if self._waits_for_key:
            self.request_key()
        return not self._waits_for_key

    def _forget_sound(self) -> None:
        waiting = [item for item in self._items if isinstance(item, ViewedSound)]
        if len(waiting) >= MAX_WAITING_SOUND:
            self._items.remove(waiting[0])

    def _forget(self, frames: list[ViewedFrame]) -> None:
        for frame in frames:
            self._items.remove(frame)

    def end(self) -> None:
        self._ended = True
        self._news.set()


class Viewers:
    """All viewers of one session. For one event loop only."""

    def __init__(self) -> None:
        self._viewers: set[Viewer] = set()
        self.form: ViewFormat | None = None
        """Encoding of the frames; None before the session is ready."""
        self.key_wanted = False
        """A viewer needs a key frame."""

    @property
    def built_on(self) -> bool:
        """Whether frames depend on earlier ones (a video codec)."""
        return self.form is not None and self.form.codec in BUILT_ON

    def announce(self, form: ViewFormat) -> None:
        """Set the format of the following frames."""
        self.form = form
        for viewer in self._viewers:
            viewer.put(form)

    def show(self, frame: ViewedFrame, stream: Stream) -> None:
        """Pass a painted frame of the session's stream to all viewers."""
        for viewer in self._viewers:
            viewer.put(frame)
        if self.key_wanted:
            self.key_wanted = False
            stream.want_key()

    def hear(self, message: bytes) -> None:
        """Pass a packet of the client's sound to the viewers that want it."""
        for viewer in self._viewers:
            if viewer.sound:
                viewer.put(ViewedSound(message))

    @contextmanager
    def watch(self, sound: bool = False) -> Iterator[Viewer]:
        """A new viewer, removed when the block ends."""
        viewer = Viewer(self, sound)
        self._viewers.add(viewer)
        if self.form is not None:
            viewer.put(self.form)
        self.key_wanted = True
        try:
            yield viewer
        finally:
            self._viewers.discard(viewer)

    def end(self) -> None:
        """The session has ended."""
        for viewer in self._viewers:
            viewer.end()

    def __len__(self) -> int:
        return len(self._viewers)
