"""Media probing: type, size, length and frame rate of a file, from its header and its decoded first frame.

`probe` runs in this process. `probe_guarded` runs in a child process with limited time and memory, because decoders may
hang, crash or allocate without limit on hostile files; the service uses this one.
"""

from __future__ import annotations

import json
from contextlib import closing, suppress
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.errors import BadInput, BadMedia, NotASequence
from pipeline.formats import image_format_of
from pipeline.video.archive import entry_stream, open_archive
from pipeline.video.clip import Clip
from pipeline.video.container import film_streams, open_container, sound_streams, video_stream
from pipeline.video.damage import damage_of
from pipeline.video.guard.decoder_process import start_decoder
from pipeline.video.headers import sniff
from pipeline.video.media import (
    SEQUENCE_FPS,
    Kind,
    Limits,
    MediaInfo,
    SourceOptions,
    check_bytes,
    check_length,
    check_size,
    unreadable,
)
from pipeline.video.numbering import frame_numbers, runs_of_numbers, sequence_numbers
from pipeline.video.reader import Source, open_source
from pipeline.video.sequence import open_zip
from pipeline.video.shot_files import ShotFiles, is_shot

if TYPE_CHECKING:
    from pydantic import JsonValue

_COLOURS = SourceOptions(opacity="straight")
"""A job, not a file, has a note about opacity that is not used."""
_STREAM_FACTS = (
    "width", "height", "frames", "fps", "duration_s", "codec", "pixel_format", "rotation_deg", "damage", "notes",
)  # fmt: skip
"""Properties of `MediaInfo` that differ between the video streams of a file."""


def probe(path: Path, limits: Limits | None = None, options: SourceOptions | None = None) -> MediaInfo:
    """Probe a file and decode its first frame.

    Raises:
        UnreadableMedia: the file is damaged or of an unknown type.
        NoVideoStream: the container has no video stream.
        MediaTooLarge: the file exceeds the limits.
    """
    limits, options = limits or Limits(), options or SourceOptions()
    check_bytes(path.stat().st_size, limits.size_bytes)
    with path.open("rb") as stream:
        if form := image_format_of(stream):
            header = form.header(stream)
            kind: Kind = "video" if header.animated else "image"
            found = MediaInfo(kind, form.media_type, codec=form.name)
            return _described(open_source(path, limits, _COLOURS), found, limits)
        media_type = sniff(stream)
    if media_type == "application/json":
        return _probe_json(path, limits)
    if media_type == "application/zip":
        return _probe_zip(path, limits)
    return _probe_video(path, media_type, limits, options)


def _probe_json(path: Path, limits: Limits) -> MediaInfo:
    check_bytes(path.stat().st_size, limits.json_bytes)
    try:
        json.loads(path.read_text("utf-8-sig"))
    except (ValueError, RecursionError) as error:
        unreadable("The file is not valid JSON.", error, "Check it with a JSON validator.")
    return MediaInfo("json", "application/json")


def _probe_zip(path: Path, limits: Limits) -> MediaInfo:
    found = MediaInfo("archive", "application/zip", codec="images")
    size = _check_members(path, limits)
    try:
        found = _described(open_zip(path, limits, source=_COLOURS), found, limits)
        return replace(found, passes=_passes(path, limits))
    except NotASequence as fault:
        why = {"message": fault.message, "value": fault.value or "", "remedy": fault.remedy}
        return replace(_loose(path, limits, size, found), fault=why)


def _passes(path: Path, limits: Limits) -> dict[str, JsonValue]:
    """The render passes of a sequence; a picture that cannot be read is a matter of its frame."""
    from pipeline.formats import has_planes
    from pipeline.formats.decoding import decode_planes, decode_raw
    from pipeline.passes.sequence import pass_sequence

    with suppress(BadInput), closing(ShotFiles(path, limits)) as files:
        if not any(map(has_planes, files)):
            return {}
        found = pass_sequence(
            files,
            lambda data, name: decode_planes(data, limits, name),
            lambda data, name: decode_raw(data, limits, name),
        )
        facts = None if found is None else found.facts()
        return facts.as_json() if facts is not None and facts.passes else {}
    return {}


def _loose(path: Path, limits: Limits, size: tuple[int, int], found: MediaInfo) -> MediaInfo:
    """Facts of images that are no sequence, such as painted keys."""
    archive, members = open_archive(path, limits)
    with archive:
        names = [member.filename for member in members]
    with suppress(NotASequence):
        numbers = sorted(number for number in frame_numbers(names).values() if number is not None)
        found = replace(found, numbers=[list(run) for run in runs_of_numbers(numbers)])
    length_s = len(names) / SEQUENCE_FPS
    return replace(
        found, width=size[0], height=size[1], frames=len(names), fps=float(SEQUENCE_FPS), duration_s=length_s,
        pixel_format="rgb24",
    )  # fmt: skip


def _check_members(path: Path, limits: Limits) -> tuple[int, int]:
    """Check the header of every image: an image of a different size would make the job fail halfway. Returns the size
    of the first one."""
    archive, members = open_archive(path, limits)
    if is_shot([member.filename for member in members]):
        archive.close()
        return _check_shot(path, limits)
    first: tuple[int, int] | None = None
    with archive:
        for member in members:
            with entry_stream(archive, member) as stream:
                form = image_format_of(stream)
                if form is None:
                    unreadable("An entry of the archive is not an image.", member.filename, "Remove that entry.")
                header = form.header(stream)
            size = (header.width, header.height)
            check_size(*size, limits, f"The image {member.filename}")
            first = first or size
            if size != first:
                sequence_numbers(m.filename for m in members)  # several sequences, each of its own size, are a question
                value = f"{member.filename}: {size[0]}x{size[1]} instead of {first[0]}x{first[1]}"
                unreadable("The images of the archive differ in size.", value, "Make all frames one size.")
    assert first is not None
    return first


def _check_shot(path: Path, limits: Limits) -> tuple[int, int]:
    """Check the layout of a shot and the header of every picture in it."""
    from pipeline.video.shot_archive import (  # a third of the decoder server's imports, seldom needed
        check_pictures,
        read_shot,
    )

    with closing(ShotFiles(path, limits)) as files, closing(open_zip(path, limits)) as frames:
        layout = read_shot(files)
        check_size(*frames.geometry.size, limits)
        check_pictures(files, layout, frames.geometry.size)
        return frames.geometry.size


def _probe_video(path: Path, media_type: str, limits: Limits, options: SourceOptions) -> MediaInfo:
    found = _probe_stream(path, media_type, limits, options)
    with open_container(path, limits) as container:
        count = len(film_streams(container))
    if options.picture is not None or count < 2:
        return found
    return replace(found, streams=tuple(_stream_facts(path, limits, number) for number in range(count)))


def _stream_facts(path: Path, limits: Limits, number: int) -> dict[str, JsonValue]:
    """Facts of one of several streams; empty if it cannot be read."""
    try:
        found = _probe_stream(path, "", limits, SourceOptions(number)).as_json()
    except BadMedia:
        return {}
    return {name: found[name] for name in _STREAM_FACTS}


def _probe_stream(path: Path, media_type: str, limits: Limits, options: SourceOptions) -> MediaInfo:
    with open_container(path, limits) as container:
        stream = video_stream(container, options.picture)
        context = stream.codec_context
        if context.width and context.height:
            check_size(context.width, context.height, limits, "The video")
        if stream.duration and stream.time_base:
            check_length(stream.frames, float(stream.duration * stream.time_base), limits)
        found = MediaInfo(
            "video",
            media_type or _media_type(container.format.name),
            codec=context.name,
            has_audio=bool(sounds := len(sound_streams(container))),
            sounds=sounds,
        )
    return _described(Clip(path, limits, replace(options or _COLOURS, opacity="straight")), found, limits)


def _media_type(demuxer: str) -> str:
    known = {"avi": "video/x-msvideo", "mpegts": "video/mp2t", "ogg": "video/ogg", "flv": "video/x-flv"}
    return known.get(demuxer, f"video/x-{demuxer.split(',')[0]}")


def _described(source: Source, found: MediaInfo, limits: Limits) -> MediaInfo:
    """Complete `found` with size, length and rate of the opened source; closes the source."""
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
            damage=damage_of(index, index.incomplete).describe("The file"),
            notes=tuple(note.message for note in source.notes),
            alpha=source.has_alpha,
            numbers=[list(run) for run in runs_of_numbers(index.numbers)],
        )
    finally:
        source.close()


def probe_guarded(
    path: Path, limits: Limits | None = None, timeout_s: float = 60.0, options: SourceOptions | None = None
) -> MediaInfo:
    """Run `probe` in a child process with limited time and memory.

    Raises:
        BadMedia: as `probe`; also UnreadableMedia if the decoder hangs, crashes or exceeds its memory limit.
    """
    task = {"path": str(path.absolute()), "limits": asdict(limits or Limits())}
    task["options"] = (options or SourceOptions()).as_json()
    child = start_decoder("probe", task, 1, timeout_s)
    child.close()
    info = child.began[0]["info"]
    return MediaInfo(**info | {"notes": tuple(info["notes"]), "streams": tuple(info["streams"])})
