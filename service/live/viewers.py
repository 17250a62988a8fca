"""Viewers of a live session: each painted frame is also sent to them. A slow viewer delays nobody else."""

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


class Viewer:
    """The frames for one viewer. For one event loop only."""

    def __init__(self, of: Viewers) -> None:
        self._of = of
        self._items: deque[ViewFormat | ViewedFrame] = deque()
        self._news = asyncio.Event()
        self._ended = False
        self._waits_for_key = True

    async def next(self) -> ViewFormat | ViewedFrame | None:
        """The next format or frame; a format precedes the first frame in it. None at the end of the session."""
        while not self._items and not self._ended:
            self._news.clear()
            await self._news.wait()
        return self._items.popleft() if self._items else None

    def request_key(self) -> None:
        """Ask for a key frame, because the viewer cannot decode the following frames."""
        self._of.key_wanted = True

    def put(self, item: ViewFormat | ViewedFrame) -> None:
        if isinstance(item, ViewFormat):
            self._items.clear()
            self._waits_for_key = True
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

    @contextmanager
    def watch(self) -> Iterator[Viewer]:
        """A new viewer, removed when the block ends."""
        viewer = Viewer(self)
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
