"""Counts and percentiles of frames over a second or a session, in bounded memory."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from workers.contract.request import Json

FIRST_S, LAST_S, GROWTH = 1e-4, 20.0, 1.02
"""Edges of a histogram's bins; percentiles have an error of at most 2 %."""
_LOG_GROWTH = math.log(GROWTH)
_BINS = math.ceil(math.log(LAST_S / FIRST_S) / _LOG_GROWTH) + 1
PERCENTILES = (50, 95, 99)


class Histogram:
    """Durations, counted in bins that grow by 2 %."""

    def __init__(self) -> None:
        self._bins = [0] * _BINS
        self.count = 0

    def add(self, seconds: float) -> None:
        place = math.ceil(math.log(max(seconds, FIRST_S) / FIRST_S) / _LOG_GROWTH)
        self._bins[min(place, _BINS - 1)] += 1
        self.count += 1

    def percentile(self, percent: float) -> float:
        """Seconds that `percent` of the durations do not exceed; 0 if there are none."""
        wanted, counted = math.ceil(self.count * percent / 100), 0
        for place, number in enumerate(self._bins):
            counted += number
            if number and counted >= wanted:
                return float(FIRST_S * GROWTH**place)
        return 0.0


@dataclass
class FrameStatistics:
    """Frames counted since `began_s`; all times in seconds of the session's clock."""

    began_s: float
    received: int = 0
    painted: int = 0
    dropped: int = 0
    latency: Histogram = field(default_factory=Histogram)
    _stages: dict[str, float] = field(default_factory=dict)

    def answered(self, latency_s: float, stages_s: Mapping[str, float]) -> None:
        """A frame was painted and its answer sent."""
        self.painted += 1
        self.latency.add(latency_s)
        for name, seconds in stages_s.items():
            self._stages[name] = self._stages.get(name, 0.0) + seconds

    def as_json(self, now_s: float) -> Json:
        """The fields of the `stats` message."""
        return {
            "received": self.received,
            "painted": self.painted,
            "dropped": self.dropped,
            "fps": round(self.painted / max(now_s - self.began_s, 1e-3), 1),
            "latency_ms": {f"p{p}": _ms(self.latency.percentile(p)) for p in PERCENTILES},
            "stages_ms": {name: _ms(total / max(self.painted, 1)) for name, total in self._stages.items()},
        }


def _ms(seconds: float) -> float:
    return round(seconds * 1000, 1)
