"""A live stream from a source through a service to a sink, at the source's own pace."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

from impasto.live.client import LiveClient, now_us
from impasto.live.sink import Sink
from impasto.live.sources import Source
from impasto.live.wire import Answer
from pipeline.frames import Frame
from workers.contract.request import Json
from workers.live.statistics import PERCENTILES, Histogram

REMEMBERED = 120
"""Maximum number of unanswered frames whose times are kept."""
CALL_INTERVAL_S = 0.1
"""Maximum time between calls of the sink, seconds, also without answers."""


@dataclass
class FrameCounts:
    """Counts of sent and received frames."""

    sent: int = 0
    late: int = 0
    """Number of frames not sent because they were late."""
    painted: int = 0
    server: Histogram = field(default_factory=Histogram)
    round_trip: Histogram = field(default_factory=Histogram)
    began_s: float = 0.0
    ended_s: float = 0.0

    def record_sent(self) -> None:
        self.began_s = self.began_s or time.monotonic()
        self.sent += 1

    def record_received(self, answer: Answer) -> None:
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


class LiveStream:
    """One stream. `run` returns after the source, after `duration_s`, when the sink ends it, or after `stop`."""

    def __init__(
        self, client: LiveClient, source: Source, sink: Sink, duration_s: float = float("inf"),
        clock: Callable[[], float] = time.monotonic,
    ) -> None:  # fmt: skip
        self.client, self.source, self.sink = client, source, sink
        self.tally = FrameCounts()
        self._duration_s, self._clock = duration_s, clock
        self._stop = threading.Event()
        self._on_the_way: deque[tuple[int, float, Frame | None]] = deque(maxlen=REMEMBERED)
        self._lock = threading.Lock()
        self._end_s = 0.0
        self._failure: Exception | None = None
        self._sender = threading.Thread(target=self._send_all, name="impasto-sender", daemon=True)

    def stop(self) -> None:
        """Send no further frames; pending answers still arrive. Callable from any thread or signal handler."""
        self._stop.set()
        self.source.stop()

    def run(self) -> str:
        """Stream to the end; returns where the output is. Errors are raised after the sink is finished."""
        self._sender.start()
        try:
            while not self.client.ended:
                for answer in self.client.answers(wait_s=CALL_INTERVAL_S):
                    self._take(answer)
                    self._check_sink()
                self._check_sink()
        finally:
            self.stop()
            self._sender.join()
            where = self.sink.finish(self._end_s)
        if self._failure:
            raise self._failure
        self.tally.late += self.source.skipped
        return where

    def _check_sink(self) -> None:
        if not self.sink.is_open():
            self.stop()

    def _take(self, answer: Answer) -> None:
        self.tally.record_received(answer)
        picture = self.client.picture(answer)
        with self._lock:
            while self._on_the_way and self._on_the_way[0][0] < answer.sequence:
                self._on_the_way.popleft()  # dropped: answers come in order
            known = self._on_the_way and self._on_the_way[0][0] == answer.sequence
            _, when, original = self._on_the_way.popleft() if known else (0, None, None)
        if when is not None:
            self.sink.put(when, picture, original)

    # -- the sender's thread

    def _send_all(self) -> None:
        try:
            self._pace()
        except Exception as error:
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
        """Wait for a frame's time. Returns False if the frame is late by more than one frame period."""
        wait_s = due_s - self._clock()
        if wait_s < -1 / self.source.fps:
            self.tally.late += 1
            return False
        return wait_s <= 0 or not self._stop.wait(wait_s)

    def _send(self, when: float, frame: Frame) -> None:
        with self._lock:
            self._on_the_way.append((self.client.next_sequence, when, frame if self.sink.needs_original else None))
        self.client.send(frame)
        self.tally.record_sent()


def _percentiles(histogram: Histogram) -> dict[str, float]:
    return {f"p{p}": round(histogram.percentile(p) * 1000, 2) for p in PERCENTILES}
