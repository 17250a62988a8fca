"""A live stream from a source through a service to a sink, at the source's own pace."""

from __future__ import annotations

import threading
import time
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from impasto.live.client import LiveClient, now_us
from impasto.live.sinks import Sink
from impasto.live.sources import Source
from impasto.live.wire import Answer
from pipeline.errors import ImpastoError
from pipeline.frames import Frame
from workers.live.figures import PERCENTILES, Histogram

Json = dict[str, Any]
REMEMBERED = 240
"""Frames on their way whose times are kept."""


@dataclass
class Tally:
    """What has been sent and what has come back."""

    sent: int = 0
    late: int = 0
    """Frames that were not sent because their time had passed."""
    painted: int = 0
    server: Histogram = field(default_factory=Histogram)
    round_trip: Histogram = field(default_factory=Histogram)
    began_s: float = field(default_factory=time.monotonic)
    ended_s: float = 0.0

    def came(self, answer: Answer) -> None:
        self.painted += 1
        self.ended_s = time.monotonic()
        self.server.add(answer.latency_us / 1e6)
        self.round_trip.add((now_us() - answer.timestamp) / 1e6)

    def as_json(self) -> Json:
        seconds = max(self.ended_s - self.began_s, 1e-3) if self.painted else 0.0
        return {
            "frames": self.sent,
            "painted": self.painted,
            "dropped": max(0, self.sent - self.painted),
            "late": self.late,
            "fps": round(self.painted / seconds, 2) if seconds else 0.0,
            "seconds": round(seconds, 3),
            "server_latency_ms": _percentiles(self.server),
            "round_trip_ms": _percentiles(self.round_trip),
        }


class Stream:
    """One stream. `run` ends with the source, after `duration_s`, when the sink has enough, or at Ctrl-C."""

    def __init__(
        self, client: LiveClient, source: Source, sink: Sink, duration_s: float = float("inf"),
        clock: Callable[[], float] = time.monotonic,
    ) -> None:  # fmt: skip
        self.client, self.source, self.sink = client, source, sink
        self.tally = Tally()
        self._duration_s, self._clock = duration_s, clock
        self._stop = threading.Event()
        self._on_the_way: OrderedDict[int, tuple[float, Frame]] = OrderedDict()
        self._lock = threading.Lock()
        self._end_s = 0.0
        self._failure: ImpastoError | None = None
        self._sender = threading.Thread(target=self._send_all, name="impasto-sender", daemon=True)

    def run(self) -> str:
        """Stream to the end, also to one by Ctrl-C; where the answers are. Raises what went wrong, after finishing."""
        self._sender.start()
        try:
            for answer in self.client.answers():
                if not self._take(answer):
                    break
        except KeyboardInterrupt:
            self._leave()
        finally:
            self._stop.set()
            self._sender.join()
            where = self.sink.finish(self._end_s)
        if self._failure:
            raise self._failure
        return where

    def _leave(self) -> None:
        """What is on its way still comes."""
        self._stop.set()
        self._sender.join()
        for answer in self.client.answers(wait_s=1.0):
            self._take(answer)

    def _take(self, answer: Answer) -> bool:
        self.tally.came(answer)
        picture = self.client.picture(answer)
        with self._lock:
            when, original = self._on_the_way.pop(answer.sequence, (None, None))
        return when is None or self.sink.put(when, picture, original)

    # -- the sender's thread

    def _send_all(self) -> None:
        try:
            self._pace()
        except ImpastoError as error:
            self._failure = error
        finally:
            self.client.close()

    def _pace(self) -> None:
        began = None
        for when, frame in self.source:
            began = self._clock() - when if began is None else began
            if self._stop.is_set() or when >= self._duration_s:
                return
            if self.source.paced or self._in_time(began + when):
                self._send(when, frame)
            self._end_s = when + 1 / self.source.fps

    def _in_time(self, due_s: float) -> bool:
        """Wait for a frame's time; False if it has passed by more than a frame, as a camera would have gone on."""
        wait_s = due_s - self._clock()
        if wait_s < -1 / self.source.fps:
            self.tally.late += 1
            return False
        return wait_s <= 0 or not self._stop.wait(wait_s)

    def _send(self, when: float, frame: Frame) -> None:
        with self._lock:
            self._on_the_way[self.client.next_sequence] = (when, frame)
            if len(self._on_the_way) > REMEMBERED:
                self._on_the_way.popitem(last=False)
        self.client.send(frame)
        self.tally.sent += 1


def _percentiles(histogram: Histogram) -> dict[str, float]:
    return {f"p{p}": round(histogram.percentile(p) * 1000, 2) for p in PERCENTILES}
