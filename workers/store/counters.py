"""Counters since the start of this process, for metrics."""

from __future__ import annotations

import threading
from collections import Counter

from workers.contract.request import Json

MEASURES = ("flicker", "detail", "structure", "edge_width_px", "faces_kept")
"""Measures of a quality report, see docs/quality.md."""


class AttemptCounters:
    """Counts of ended attempts. Thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._attempts: Counter[str] = Counter()
        self._failures: Counter[str] = Counter()
        self._frames: Counter[str] = Counter()
        self._seconds: dict[str, float] = {}
        self._reports: dict[str, dict[str, list[float]]] = {}
        """Measure -> method -> [number of reports, sum of its values]."""

    def ended(self, outcome: str, code: str, method: str, frames: int, seconds: float) -> None:
        """An attempt ended.

        Args:
            code: code of its fault, or empty.
            frames: number of frames that it finished; 0 unless it succeeded.
            seconds: time since its claim.
        """
        with self._lock:
            self._attempts[outcome] += 1
            self._seconds[method] = self._seconds.get(method, 0.0) + max(0.0, seconds)
            if code:
                self._failures[code] += 1
            if frames:
                self._frames[method] += frames

    def reported(self, method: str, quality: Json) -> None:
        """A job has finished with this summary of its quality report."""
        with self._lock:
            for measure in MEASURES:
                if isinstance(value := quality.get(measure), int | float):
                    row = self._reports.setdefault(measure, {}).setdefault(method, [0.0, 0.0])
                    row[0] += 1
                    row[1] += value

    def counts(self) -> Json:
        """Attempts by outcome, failures by code, frames, busy seconds and quality reports by method."""
        with self._lock:
            return {
                "attempts": dict(self._attempts),
                "failures": dict(self._failures),
                "frames": dict(self._frames),
                "busy_s": dict(self._seconds),
                "reports": {
                    measure: {method: tuple(row) for method, row in rows.items()}
                    for measure, rows in self._reports.items()
                },
            }
