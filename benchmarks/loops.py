"""Loops a short clip to any length by repeating its packets, without decoding."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import count, islice
from pathlib import Path

import av
from av.container import InputContainer
from av.packet import Packet
from av.video.stream import VideoStream

from benchmarks.clips import MEDIA
from impasto.cli.app import run


def looped(source: Path, frames: int, out: Path) -> Path:
    """Write `frames` frames of `source`, an MP4, looped as often as necessary, without sound."""
    with av.open(str(source)) as given, av.open(str(out), "w") as target:
        stream = target.add_stream_from_template(given.streams.video[0])
        for packet in islice(_packets(given), frames):
            packet.stream = stream
            target.mux(packet)
    return out


def _packets(given: InputContainer) -> Iterator[Packet[VideoStream]]:
    """The video's packets in an endless loop; timestamps rise by the clip's duration with each repetition."""
    video = given.streams.video[0]
    assert video.average_rate and video.time_base
    length = round(video.frames / (video.average_rate * video.time_base))
    for number in count():
        for packet in given.demux(video):
            if packet.pts is not None and packet.dts is not None:
                packet.pts, packet.dts = packet.pts + number * length, packet.dts + number * length
                yield packet
        given.seek(0)


def source(name: str, size: str, folder: Path) -> Path:
    """The real clip `name` if there is a media folder, otherwise a procedural scene of size `size` with a cut."""
    if (MEDIA / name).is_file():
        return MEDIA / name
    drawn = folder / "scene.mp4"
    if run(["scene", "cut", "-o", str(drawn), "--size", size, "--quiet"]):
        raise SystemExit("The scene could not be drawn.")
    return drawn
