"""GIF: read with its times; written with one palette of 256 colours for the whole film, ordered dithering, and times to
a hundredth of a second.

Ordered dithering (a fixed 8 x 8 pattern) leaves still parts of the picture still. Error diffusion would let a change in
one place alter the pixels of all rows below.
"""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path

import av
from av.filter import Graph
from av.filter.context import FilterContext
from av.video.stream import VideoStream

from pipeline.formats.animations import LOSSLESS_PICTURES
from pipeline.formats.base import Carries, OutputFormat, Profile, Progress, Segments
from pipeline.formats.pillow import PillowFormat
from pipeline.video.container import finished, open_container
from pipeline.video.media import Limits

TICK = Fraction(1, 100)
"""Unit of time of the format, seconds."""
_SHORTEST_TICKS = 2
"""Browsers show a frame with a shorter duration ten times as long."""
_PALETTE_FRAMES = 64
_DITHER = "dither=bayer:bayer_scale=3"
_SHARE_OF_PALETTE = 0.3


def join_gif(segments: Segments, out: Path, progress: Progress = lambda done: None, quality: int = 0) -> None:
    """Write a GIF that is repeated without end.

    Args:
        segments: (start time in seconds, file) of each segment, in order, at least one; the first start becomes 0.
        progress: called with the fraction done, 0..1; may raise an exception to abort.
        quality: has no effect.
    """
    palette, count = _palette(segments, progress)
    with av.open(f"file:{out}", "w", format="gif", options={"loop": "0"}) as target:
        stream = target.add_stream("gif", rate=25)
        assert isinstance(stream, VideoStream)
        stream.width, stream.height = _size(segments)
        stream.pix_fmt = "pal8"
        stream.codec_context.time_base = TICK
        for done, picture in enumerate(_mapped(segments, palette)):
            target.mux(stream.encode(picture))
            progress(_SHARE_OF_PALETTE + (1 - _SHARE_OF_PALETTE) * min(1.0, (done + 1) / count))
        target.mux(stream.encode(None))


def _size(segments: Segments) -> tuple[int, int]:
    with open_container(segments[0][1], Limits()) as source:
        stream = source.streams.video[0]
        return stream.width, stream.height


def _frames(segments: Segments) -> Iterator[tuple[int, av.VideoFrame]]:
    """(time in ticks, picture) of each frame; frames too short to be shown are left out."""
    shown = -_SHORTEST_TICKS
    for start_s, path in segments:
        with open_container(path, Limits()) as source:
            stream = source.streams.video[0]
            for picture in source.decode(stream):
                assert picture.pts is not None and picture.time_base is not None
                at = round((start_s - segments[0][0] + picture.pts * picture.time_base) / TICK)
                if at >= shown + _SHORTEST_TICKS:
                    shown = at
                    yield at, picture


def _palette(segments: Segments, progress: Progress) -> tuple[av.VideoFrame, int]:
    """The palette of at most `_PALETTE_FRAMES` frames, evenly spaced, and the number of all frames."""
    count = 0
    for _start, path in segments:
        with open_container(path, Limits()) as source:
            count += sum(1 for packet in source.demux(source.streams.video[0]) if packet.size)
    step = max(1, count // _PALETTE_FRAMES)
    graph, source_filter, sink = Graph(), None, None
    for number, (_at, picture) in enumerate(_frames(segments)):
        if number % step:
            continue
        if source_filter is None:
            source_filter, sink = _palette_graph(graph, picture)
        picture.pts = number
        source_filter.push(picture)
        progress(_SHARE_OF_PALETTE * number / count)
    assert source_filter is not None and sink is not None
    source_filter.push(None)
    return next(finished(sink)), count


def _palette_graph(graph: Graph, picture: av.VideoFrame) -> tuple[FilterContext, FilterContext]:
    first = _input(graph, picture, "video")
    make = graph.add("palettegen", "stats_mode=full:reserve_transparent=0")
    last = graph.add("buffersink")
    first.link_to(make)
    make.link_to(last)
    graph.configure()
    return first, last


def _mapped(segments: Segments, palette: av.VideoFrame) -> Iterator[av.VideoFrame]:
    """The frames in the palette's colours."""
    graph, first, last = Graph(), None, None
    for at, picture in _frames(segments):
        if first is None or last is None:
            first = _input(graph, picture, "video")
            colours = _input(graph, palette, "palette")
            use, last = graph.add("paletteuse", f"{_DITHER}:diff_mode=rectangle"), graph.add("buffersink")
            first.link_to(use)
            colours.link_to(use, 0, 1)
            use.link_to(last)
            graph.configure()
            palette.pts = 0
            colours.push(palette)
            colours.push(None)
        picture.pts, picture.time_base = at, TICK
        first.push(picture)
        yield from finished(last)
    if first is not None and last is not None:
        first.push(None)
        yield from finished(last)


def _input(graph: Graph, picture: av.VideoFrame, name: str) -> FilterContext:
    return graph.add_buffer(
        width=picture.width, height=picture.height, format=picture.format, time_base=TICK, name=name
    )


class Gif(PillowFormat):
    name, title, media_type, plugin = "gif", "GIF", "image/gif", "GIF"
    suffixes = (".gif",)
    magic = (b"GIF87a", b"GIF89a")
    carries = Carries(alpha=True, animation=True)


GIF = Gif()
GIF_FILM = OutputFormat(
    name="gif", title="GIF", help="At most 720 px, 256 colours, without sound", media_type="image/gif",
    suffixes=(".gif",), lossy=True, shown_as="image", container="gif", max_side_px=720, join=join_gif,
    profiles=(
        Profile(
            name="256", title="256 colours", has_quality=False, low_bytes_per_pixel=0.1, bytes_per_pixel=0.5,
            **LOSSLESS_PICTURES,
        ),
    ),
)  # fmt: skip
