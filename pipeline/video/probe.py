"""What is this file? Really decodes the header and the first frame; never trusts a name.

`probe` works in this process. `probe_guarded` works in a child that can be killed and has little memory, because
decoders may hang, crash or allocate without end on hostile bytes: the service uses that one.
"""

from __future__ import annotations

import json
from contextlib import closing
from dataclasses import asdict, replace
from pathlib import Path

from pipeline.video.archive import entry_stream, open_archive
from pipeline.video.clip import Clip
from pipeline.video.container import open_container, video_stream
from pipeline.video.guard.nursery import begin
from pipeline.video.headers import IMAGE_TYPES, image_header, is_still, sniff
from pipeline.video.media import (
    Limits,
    MediaInfo,
    check_bytes,
    check_length,
    check_size,
    unreadable,
)
from pipeline.video.sequence import Sequence, open_still, open_zip
from pipeline.video.shot import check_pictures, read_shot
from pipeline.video.shot_files import ShotFiles, is_shot


def probe(path: Path, limits: Limits | None = None) -> MediaInfo:
    """Find out what a file is, decoding its first frame.

    Raises: UnreadableMedia, NoVideoStream, MediaTooLarge, each with field, value and remedy.
    """
    limits = limits or Limits()
    check_bytes(path.stat().st_size, limits.size_bytes)
    with path.open("rb") as stream:
        media_type = sniff(stream)
        if media_type in (*IMAGE_TYPES, "image/gif"):
            header = image_header(stream, media_type)
            check_size(header.width, header.height, limits)
            if is_still(header):
                return _probe_still(path, media_type, limits)
    if media_type == "application/json":
        return _probe_json(path, limits)
    if media_type == "application/zip":
        return _probe_zip(path, limits)
    return _probe_video(path, media_type, limits)


def _probe_json(path: Path, limits: Limits) -> MediaInfo:
    check_bytes(path.stat().st_size, limits.json_bytes)
    try:
        json.loads(path.read_text("utf-8-sig"))
    except (ValueError, RecursionError) as error:
        unreadable("The file looks like JSON and is not.", error, "Check it with a JSON validator.")
    return MediaInfo("json", "application/json")


def _probe_still(path: Path, media_type: str, limits: Limits) -> MediaInfo:
    codec = media_type.removeprefix("image/")
    return _described(open_still(path, limits), MediaInfo("image", media_type, codec=codec), limits)


def _probe_zip(path: Path, limits: Limits) -> MediaInfo:
    _check_members(path, limits)
    return _described(open_zip(path, limits), MediaInfo("archive", "application/zip", codec="images"), limits)


def _check_members(path: Path, limits: Limits) -> None:
    """Every image's header: one of another size would stop a job half-way."""
    archive, members = open_archive(path, limits)
    if is_shot([member.filename for member in members]):
        archive.close()
        _check_shot(path, limits)
        return
    first: tuple[int, int] | None = None
    with archive:
        for member in members:
            with entry_stream(archive, member) as stream:
                media_type = sniff(stream)
                if media_type not in IMAGE_TYPES:
                    unreadable("An entry of the archive is not an image.", member.filename, "Remove that entry.")
                header = image_header(stream, media_type)
            size = (header.width, header.height)
            check_size(*size, limits, f"The image {member.filename}")
            first = first or size
            if size != first:
                value = f"{member.filename}: {size[0]}x{size[1]} instead of {first[0]}x{first[1]}"
                unreadable("The images of the archive have several sizes.", value, "Make all frames one size.")


def _check_shot(path: Path, limits: Limits) -> None:
    """A shot's layout, and the header of every picture in it."""
    with closing(ShotFiles(path, limits)) as files, closing(open_zip(path, limits)) as frames:
        layout = read_shot(files)
        check_size(*frames.geometry.size, limits)
        check_pictures(files, layout, frames.geometry.size)


def _probe_video(path: Path, media_type: str, limits: Limits) -> MediaInfo:
    with open_container(path, limits) as container:
        stream = video_stream(container)
        context = stream.codec_context
        if context.width and context.height:
            check_size(context.width, context.height, limits, "The video")
        if stream.duration and stream.time_base:
            check_length(stream.frames, float(stream.duration * stream.time_base), limits)
        found = MediaInfo(
            "video",
            media_type or _media_type(container.format.name),
            codec=context.name,
            has_audio=any(s.codec_context is not None for s in container.streams.audio),
        )
    return _described(Clip(path, limits), found, limits)


def _media_type(demuxer: str) -> str:
    known = {"avi": "video/x-msvideo", "mpegts": "video/mp2t", "ogg": "video/ogg", "flv": "video/x-flv"}
    return known.get(demuxer, f"video/x-{demuxer.split(',')[0]}")


def _described(source: Clip | Sequence, found: MediaInfo, limits: Limits) -> MediaInfo:
    """`found` with what the opened source knows; closes it."""
    try:
        index, (width, height) = source.index, source.geometry.size
        check_size(width, height, limits)
        check_length(len(index.pts), index.duration_s, limits)
        single = len(index.pts) == 1 and found.kind == "video"
        return replace(
            found,
            kind="image" if single else found.kind,
            width=width,
            height=height,
            frames=len(index.pts),
            fps=round(index.fps, 6),
            duration_s=round(index.duration_s, 6),
            pixel_format=source.pixel_format,
            rotation_deg=source.geometry.rotation_deg,
        )
    finally:
        source.close()


def probe_guarded(path: Path, limits: Limits | None = None, timeout_s: float = 60.0) -> MediaInfo:
    """`probe` in a child process with bounded time and memory.

    Raises: what `probe` raises; UnreadableMedia too if the decoder hangs, crashes or wants too much memory.
    """
    task = {"path": str(path.absolute()), "limits": asdict(limits or Limits())}
    child = begin("probe", task, 1, timeout_s)
    child.close()
    return MediaInfo(**child.began[0]["info"])
