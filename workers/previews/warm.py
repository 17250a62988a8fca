"""Frames of proxy size, decoded once and cached."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, ExitStack, suppress

from pydantic import JsonValue

from pipeline.arrays import AnyArray
from pipeline.errors import BadInput, BadParameter
from pipeline.frames import Frame
from pipeline.methods.base import VideoInfo
from pipeline.passes.sequence import pass_sequence
from pipeline.video.contact_sheet import fit
from pipeline.video.guard.files import GuardedImages
from pipeline.video.guard.pictures import guarded_planes, guarded_raw
from pipeline.video.guard.reader import GuardedReader
from pipeline.video.headers import sniff
from pipeline.video.shot_files import ShotFiles
from workers.blobs.base import Blobs
from workers.execution.decoders import Decoders, frame_at
from workers.previews.byte_cache import ByteCache
from workers.previews.model import of_video_key

_AHEAD = 4
"""Number of frames decoded in advance, because users often step forwards."""


class WarmFrames:
    """Frames of videos by `video_key`. Thread-safe.

    Arrays are returned as copies, so that callers cannot change the cache, and so that kernels compiled for writable
    arrays are used.
    """

    def __init__(self, blobs: Blobs, cache: ByteCache) -> None:
        self._blobs, self._cache = blobs, cache
        self._decoders = Decoders(blobs)

    def close(self) -> None:
        self._decoders.close()

    def info(self, key: str) -> VideoInfo:
        """Size at full resolution, frame count, frame rate."""

        def probe() -> VideoInfo:
            with self._reader(key, 0) as reader:
                width, height = reader.size
                return VideoInfo(width, height, reader.frames, reader.fps, reader.frames / max(reader.fps, 1e-6))

        return self._cache.get(("info", key), probe, lambda _: 200)

    def frames(self, key: str, start: int, stop: int, side_px: int) -> list[Frame]:
        """Frames [start, stop), as far as they exist, scaled to fit `side_px`; never enlarged."""
        start, stop = max(0, start), min(stop, self.info(key).frames)
        wanted = range(start, stop)
        found = {index: self._cache.peek((key, side_px, index)) for index in wanted}
        missing = [index for index in wanted if found[index] is None]
        if missing:
            for index, frame in self._decode(key, missing[0], missing[-1] + 1, side_px):
                found[index] = frame
        return [found[index].copy() for index in wanted if found[index] is not None]

    def frame(self, key: str, index: int, side_px: int) -> Frame:
        """Frame `index`, or the last one of a shorter video. Raises UnreadableMedia: it cannot be decoded."""
        index = min(max(index, 0), self.info(key).frames - 1)
        for frame in self.frames(key, index, index + 1, side_px):
            return frame
        with self._reader(key, index) as reader:
            return fit(frame_at(reader, index), side_px)

    def full(self, key: str, index: int) -> Frame:
        """A frame at full resolution, which is not cached."""
        index = min(max(index, 0), self.info(key).frames - 1)
        with self._reader(key, index) as reader:
            return next(reader.read(index, index + 1))

    def stream(self, key: str, start: int, stop: int) -> Iterator[Frame]:
        """Frames [start, stop) at full resolution, one at a time."""
        with self._reader(key, start) as reader:
            yield from reader.read(start, stop)

    def image(self, source: str | bytes, field: str) -> AnyArray:
        """A drawing as stored, 8 or 16 bit, with alpha. `source`: blob key, or the file's bytes."""
        data = source if isinstance(source, bytes) else self._blobs.get(source)
        return guarded_raw(data, field)

    def archive(self, key: str, field: str, exit_stack: ExitStack) -> Mapping[int, AnyArray]:
        """The images of an archive by frame, decoded on access until `exit_stack` ends."""
        found = GuardedImages(exit_stack.enter_context(self._blobs.local(key)), field)
        exit_stack.callback(found.close)
        return found

    def entries(self, key: str, exit_stack: ExitStack) -> Mapping[str, bytes]:
        """The files of an archive by path, read on access until `exit_stack` ends; empty if it is no archive. `key`: a
        `video_key`."""
        path = exit_stack.enter_context(self._blobs.local(of_video_key(key)[0]))
        with path.open("rb") as stream:
            if sniff(stream) != "application/zip":
                return {}
        found = ShotFiles(path)
        exit_stack.callback(found.close)
        return found

    def pass_facts(self, key: str) -> dict[str, JsonValue]:
        """What is known about the render passes of a video, found once; empty: it has none. `key`: a `video_key`."""

        def find() -> dict[str, JsonValue]:
            with ExitStack() as exit_stack, suppress(BadInput):
                if (passes := pass_sequence(self.entries(key, exit_stack), guarded_planes, guarded_raw)) is not None:
                    return passes.facts().as_json()
            return {}

        found: dict[str, JsonValue] = self._cache.get(("passes", key), find, lambda _: 4000)
        return found

    def document(self, key: str, field: str) -> JsonValue:
        """A JSON file."""
        try:
            parsed: JsonValue = json.loads(self._blobs.get(key))
        except ValueError as error:
            raise BadParameter(f"The input is not JSON: {error}.", field=field) from None
        return parsed

    def _reader(self, key: str, start: int) -> AbstractContextManager[GuardedReader]:
        blob, source = of_video_key(key)
        return self._decoders.reader(blob, start, source)

    def _decode(self, key: str, start: int, stop: int, side_px: int) -> Iterator[tuple[int, Frame]]:
        with self._reader(key, start) as reader:
            for index, frame in enumerate(reader.read(start, min(stop + _AHEAD, reader.frames)), start):
                small = fit(frame, side_px)
                self._cache.put((key, side_px, index), small, small.nbytes)
                yield index, small
