"""Sources of frames: a video file, a camera, a network stream."""

from __future__ import annotations

import itertools
import queue
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Protocol

import av
import cv2
import numpy as np
from av.container import InputContainer
from av.video.stream import VideoStream

from pipeline.errors import BadInput, ImpastoError
from pipeline.frames import Frame
from pipeline.video.fields import deinterlaced
from pipeline.video.geometry import geometry_of, to_frame
from pipeline.video.media import Fields, SourceOptions
from pipeline.video.reader import VideoReader

Size = tuple[int, int]
Timed = tuple[float, Frame]
"""Time of a frame, seconds from the first, and the frame."""
NETWORK = ("rtsp://", "rtsps://", "rtmp://", "http://", "https://", "udp://", "tcp://", "srt://")
OPEN_S = 10
"""Maximum silence of a camera or sender, seconds."""
LEAVE_S = 2
_CAMERA_FORMATS = {"linux": "v4l2", "darwin": "avfoundation", "win32": "dshow"}


class SourceLost(ImpastoError):
    """A camera or network stream has stopped unexpectedly."""

    code = "source-lost"


@dataclass(frozen=True)
class Sound:
    """Sound of the source."""

    path: Path
    """A media file, which may have no sound."""
    first_s: Fraction
    """Time of the first picture in the file, seconds."""
    length_s: float
    """Duration of the pictures, seconds."""


class Source(Protocol):
    """Frames of one size."""

    size: Size
    """(width, height), px."""
    fps: float
    """Nominal frames per second."""
    paced: bool
    """Whether frames arrive in real time; frames of a file do not, and are paced by the caller."""
    sound: Sound | None
    skipped: int
    """Number of frames that were replaced before the caller took them."""

    def __iter__(self) -> Iterator[Timed]:
        """Raises SourceLost, UnreadableMedia."""
        ...

    def stop(self) -> None:
        """Stop soon. Callable from any thread."""
        ...

    def close(self) -> None:
        """Release the source."""
        ...


def open_source(text: str, loops: int, size: Size | None, fps: float | None, fields: Fields = "auto") -> Source:
    """A source by its name: a path, `camera`, `camera:N`, or an address.

    Args:
        loops: how often a file is played, 0 = without end.
        size: scale frames to it, (width, height) px; None: as they come.
        fps: rate to ask a camera for, or to play a file at.
        fields: see `pipeline.video.media.SourceOptions`.

    Raises: BadInput (no such file, camera or stream), UnreadableMedia, NoVideoStream.
    """
    source: Source
    if text == "camera" or text.startswith("camera:"):
        source = _camera(text, size, fps)
    elif text.startswith(NETWORK):
        check_protocol(text, "--input")
        source = StreamSource(text, None, {}, fps, "Check the address, and that the sender is on.", fields)
    else:
        source = FileSource(Path(text).expanduser(), loops, fps, fields)
    return source if size is None or source.size == size else Scaled(source, size)


def check_protocol(address: str, field: str) -> None:
    """Check that this FFmpeg knows SRT, if the address needs it: few builds contain its library. Raises BadInput."""
    if not address.startswith("srt://"):
        return
    try:
        av.open("srt://").close()
    except av.ProtocolNotFoundError:
        raise BadInput(
            "The FFmpeg of this PyAV was built without SRT.", field=field, value=address,
            remedy="Build PyAV against an FFmpeg with libsrt (pip install --no-binary av av), use rtmp, or relay "
            "with another FFmpeg: ffmpeg -i srt://... -c copy -f mpegts udp://127.0.0.1:5000",
        ) from None  # fmt: skip
    except (av.FFmpegError, OSError, ValueError):
        return  # it is known: only this address is empty


class FileSource:
    """A video file; frame times are its own, or `fps` apart."""

    paced = False
    skipped = 0

    def __init__(self, path: Path, loops: int, fps: float | None, fields: Fields = "auto") -> None:
        if not path.exists():
            raise BadInput(
                "File not found.", field="--input", value=path,
                remedy="Give a video file, camera, camera:1, or an address such as rtsp://host/stream.",
            )  # fmt: skip
        self._reader, self._loops = VideoReader(path, options=SourceOptions(fields=fields)), loops
        self.size, self.fps = self._reader.size, fps or self._reader.fps
        index = self._reader.index
        ticks = [*(int(t) for t in index.pts), index.end]
        self._times = [float((t - ticks[0]) * index.time_base) for t in ticks]
        with_sound = loops == 1 and fps is None and path.is_file()
        self.sound = Sound(path, ticks[0] * index.time_base, self._times[-1]) if with_sound else None
        if fps:
            self._times = [n / fps for n in range(len(ticks))]

    def __iter__(self) -> Iterator[Timed]:
        for loop in itertools.count() if self._loops == 0 else range(self._loops):
            for number, frame in enumerate(self._reader.read()):
                yield loop * self._times[-1] + self._times[min(number, len(self._times) - 2)], frame

    def stop(self) -> None:
        """A file needs no interruption."""

    def close(self) -> None:
        self._reader.close()


class StreamSource:
    """A camera or network stream, read on its own thread. Only the newest frame is kept."""

    paced = True
    sound: Sound | None = None

    def __init__(
        self, name: str, kind: str | None, options: dict[str, str], fps: float | None, remedy: str,
        fields: Fields = "auto",
    ) -> None:  # fmt: skip
        self._name, self._remedy = name, remedy
        self._container = self._open(kind, options)
        stream = self._container.streams.video[0]
        stream.thread_type = "NONE"  # threads hold frames back
        self._pictures = self._decoded(stream, fields)
        first = self._first()
        self._geometry = geometry_of(first, stream.codec_context.sample_aspect_ratio)
        self.size = self._geometry.size
        self.fps = fps or float(stream.average_rate or 30)
        self.skipped = 0
        self._newest: queue.Queue[Timed | None] = queue.Queue(1)
        self._stop = threading.Event()
        self._lost = ""
        self._thread = threading.Thread(target=self._read, args=(first,), name="impasto-source", daemon=True)
        self._thread.start()

    def _decoded(self, stream: VideoStream, fields: Fields) -> Iterator[av.VideoFrame]:
        """The pictures; an interlaced one is made a frame when the next one has arrived."""
        for _number, picture in deinterlaced(enumerate(self._container.decode(stream)), fields):
            yield picture

    def _open(self, kind: str | None, options: dict[str, str]) -> InputContainer:
        try:
            container = av.open(self._name, format=kind, options=options, timeout=(OPEN_S, OPEN_S))
        except (av.FFmpegError, OSError, ValueError) as error:
            raise self._failed(str(error)) from None
        if not container.streams.video:
            container.close()
            raise self._failed("it has no video")
        return container

    def _first(self) -> av.VideoFrame:
        try:
            return next(self._pictures)
        except (av.FFmpegError, StopIteration, OSError) as error:
            self._container.close()
            raise self._failed(str(error) or "it sends no frames") from None

    def _failed(self, why: str) -> BadInput:
        return BadInput(f"It cannot be opened: {why}.", field="--input", value=self._name, remedy=self._remedy)

    def _read(self, first: av.VideoFrame) -> None:
        began = time.monotonic()
        try:
            for picture in itertools.chain([first], self._pictures):
                if self._stop.is_set():
                    break
                self._offer((time.monotonic() - began, to_frame(picture, self._geometry)))
        except (av.FFmpegError, OSError, ImpastoError) as error:
            self._lost = str(error)
        finally:
            self._newest.put(None)

    def _offer(self, timed: Timed) -> None:
        try:
            self._newest.get_nowait()
            self.skipped += 1
        except queue.Empty:
            pass
        self._newest.put(timed)

    def __iter__(self) -> Iterator[Timed]:
        while not self._stop.is_set():
            with suppress(queue.Empty):
                timed = self._newest.get(timeout=0.1)
                if timed is None:
                    self._newest.put(None)  # a second iteration also finds the end
                    break
                yield timed
        if self._lost and not self._stop.is_set():
            raise SourceLost(
                f"It has stopped: {self._lost}.", field="--input", value=self._name,
                remedy="The output up to then is complete. Check the source, then start again.",
            )  # fmt: skip

    def stop(self) -> None:
        self._stop.set()

    def close(self) -> None:
        self._stop.set()
        deadline = time.monotonic() + LEAVE_S
        while self._thread.is_alive() and time.monotonic() < deadline:
            with suppress(queue.Empty):
                self._newest.get(timeout=0.1)  # the reader may wait for space in the queue
        if not self._thread.is_alive():  # otherwise it waits for a silent sender, and ends with the process
            self._container.close()


class Scaled:
    """Frames of another source, resized."""

    def __init__(self, source: Source, size: Size) -> None:
        self._source, self.size, self.skipped = source, size, 0
        self.fps, self.paced, self.sound = source.fps, source.paced, source.sound

    def __iter__(self) -> Iterator[Timed]:
        for when, frame in self._source:
            self.skipped = self._source.skipped
            how = cv2.INTER_AREA if frame.shape[1] > self.size[0] else cv2.INTER_LINEAR
            yield when, np.asarray(cv2.resize(frame, self.size, interpolation=how), np.uint8)

    def stop(self) -> None:
        self._source.stop()

    def close(self) -> None:
        self._source.close()


def _camera(text: str, size: Size | None, fps: float | None) -> StreamSource:
    _, _, number = text.partition(":")
    if number and not number.isdigit():
        raise BadInput(
            "The number of the camera is not valid.", field="--input", value=text, remedy="Write camera, or camera:1."
        )
    kind = _CAMERA_FORMATS.get(sys.platform, "v4l2")
    name = f"/dev/video{number or 0}" if kind == "v4l2" else (number or "0")
    options = {"framerate": str(Fraction(fps or 30).limit_denominator(1001))}
    if size:
        options["video_size"] = f"{size[0]}x{size[1]}"
    remedy = "Plug a camera in, choose another with camera:N, or use a video file."
    return StreamSource(name, kind, options, fps, remedy)
