"""Packets of a file with continuous times: streams that were joined begin again, or jump, in their middle.

The rule is that of FFmpeg's command (`ts_discontinuity_process` in fftools/ffmpeg_demux.c): decoding times that go back
by more than 0.1 s are an error in every container; in containers of broadcasts also those that jump ahead by more than
10 s. One shift then applies to all streams, so that sound and pictures stay together.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from av.container import InputContainer
from av.format import Flags
from av.packet import Packet
from av.stream import Discard, Stream

from pipeline.video.container import MOV, film_streams, sound_streams

_BACK_US = 100_000
_AHEAD_US = 10_000_000
_NEVER_US = 1 << 62


class Timeline:
    """The shift of each packet, in the order of the file.

    Args:
        known: `shifts` of an earlier reading of the whole file. Without them, sound that reaches a new part before the
            pictures do gets a provisional shift.

    Times of MP4 and MOV are stored as durations and need no correction, although an edit list may go back.
    """

    def __init__(self, container: InputContainer, known: Sequence[int] = ()) -> None:
        jumps = Flags.ts_discont in Flags(container.format.flags)
        self._ahead_us = _AHEAD_US if jumps else _NEVER_US
        self._back_us = _NEVER_US if container.format.name == MOV else _BACK_US
        self._film = {stream.index for stream in film_streams(container)}
        self._shifts, self._known = [0], [*known]
        self._provisional = False
        self._part: dict[int, int] = {}
        """Stream -> the part of the file that it has reached, an index of `_shifts`."""
        self._last: dict[int, tuple[int, int]] = {}
        """Stream -> decoding time of its last packet and the time at which the next one is due, microseconds."""

    @property
    def corrections(self) -> int:
        """Number of times at which the times began again or jumped."""
        return len(self._shifts) - 1

    @property
    def shifts(self) -> tuple[int, ...]:
        """The shift of each part of the file, microseconds; final when all packets have been read."""
        return tuple(self._shifts)

    @property
    def end_s(self) -> float:
        """End of the last packet, seconds."""
        return max((due + self._shifts[self._part[at]] for at, (_last, due) in self._last.items()), default=0) / 1e6

    def shift_us(self, packet: Packet[Any]) -> int:
        """Microseconds to add to the packet's times."""
        at = packet.stream_index
        part = self._part.setdefault(at, len(self._shifts) - 1)
        if packet.dts is None or not packet.time_base:
            return self._shifts[part]
        raw = round(packet.dts * packet.time_base * 1_000_000)
        last, due = self._last.get(at, (raw, raw))
        if raw < last - self._back_us or raw > due + self._ahead_us:
            part = self._part[at] = self._next_part(at, part, due + self._shifts[part] - raw)
        step = round((packet.duration or 0) * packet.time_base * 1_000_000) or max(0, raw - last)
        self._last[at] = (raw, raw + step)
        return self._shifts[part]

    def _next_part(self, at: int, part: int, wanted: int) -> int:
        """The part in which a packet of stream `at` is that does not continue `part`: that of another stream if it
        fits, or a new one. The pictures, when they reach it, follow without a gap."""
        newest = len(self._shifts) - 1
        if newest == part or abs(wanted - self._shifts[newest]) > _AHEAD_US:
            newest += 1
            self._shifts.append(self._known[newest] if newest < len(self._known) else wanted)
            self._provisional = newest >= len(self._known) and at not in self._film
        elif self._provisional and at in self._film:
            self._shifts[newest], self._provisional = wanted, False
        return newest


def timed_packets(
    container: InputContainer, wanted: Sequence[Stream], timeline: Timeline | None = None
) -> Iterator[tuple[Packet[Any], int]]:
    """Packets of the wanted streams, each with its shift in microseconds, and the empty packets at the end.

    Where times may be corrected, every reader looks at the same streams, so that all find the same shifts.
    """
    indices = {stream.index for stream in wanted}
    read = [*wanted]
    if container.format.name != MOV:
        read += [s for s in (*film_streams(container), *sound_streams(container)) if s.index not in indices]
    for stream in container.streams:
        if all(stream.index != other.index for other in read):
            stream.discard = Discard.all
    timeline = timeline or Timeline(container)
    for packet in container.demux(*read):
        shift = timeline.shift_us(packet) if packet.size else 0
        if packet.stream_index in indices:
            yield packet, shift
