"""Prometheus metrics: base units, `_total` on counters, labels from small fixed sets."""

from __future__ import annotations

import logging
import time
from collections import Counter as Counts
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, SummaryMetricFamily
from prometheus_client.metrics_core import Metric
from prometheus_client.registry import Collector

from workers.contract.request import Json
from workers.farm import Farm
from workers.operator_views import DrainScope

log = logging.getLogger(__name__)

LATENCY_S = (0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1, 2.5, 5, 10, 30, 120)
LIVE_LATENCY_S = (0.005, 0.01, 0.0167, 0.025, 0.0333, 0.05, 0.0667, 0.1, 0.2, 0.5, 1, 5)
VERBS = frozenset({"GET", "HEAD", "POST", "PATCH", "PUT", "DELETE", "OPTIONS"})
MAX_LABELS = 50
"""Maximum number of values of one label; further ones are dropped."""


class HttpMetrics:
    """Requests that this process has answered."""

    def __init__(self, registry: CollectorRegistry, streams: Callable[[], float]) -> None:
        labels = ("method", "route", "status")
        self.requests = Counter("impasto_http_requests", "Requests answered.", labels, registry=registry)
        self.seconds = Histogram(
            "impasto_http_request_duration_seconds",
            "From a request's first byte to the start of its answer.",
            ("method", "route"),
            buckets=LATENCY_S,
            registry=registry,
        )
        Gauge("impasto_event_streams", "Event streams open now.", registry=registry).set_function(streams)

    def record(self, verb: str, route: str, status: int, seconds: float) -> None:
        verb = verb if verb in VERBS else "other"
        self.requests.labels(verb, route, str(status)).inc()
        self.seconds.labels(verb, route).observe(seconds)


class LiveMetrics:
    """Frames and latencies of live sessions in this process."""

    def __init__(self, registry: CollectorRegistry, sessions: Callable[[], float]) -> None:
        Gauge("impasto_live_sessions", "Live sessions now.", registry=registry).set_function(sessions)
        frames = Counter("impasto_live_frames", "Frames of live sessions.", ("outcome",), registry=registry)
        self.received, self.painted, self.dropped = (frames.labels(o) for o in ("received", "painted", "dropped"))
        self.lost = Counter("impasto_live_workers_lost", "Workers that died under a live session.", registry=registry)
        self.latency = Histogram(
            "impasto_live_latency_seconds",
            "From a live frame fully received to its answer sent.",
            buckets=LIVE_LATENCY_S,
            registry=registry,
        )


class FarmMetrics(Collector):
    """The farm's snapshot as metrics, read at each scrape."""

    def __init__(self, farm: Farm) -> None:
        self._farm = farm

    def describe(self) -> Iterable[Metric]:
        """Return no metrics at registration, which must not query the store."""
        return ()

    def collect(self) -> Iterator[Metric]:
        began = time.perf_counter()
        try:
            snapshot = self._farm.snapshot()
            drained = Counts(drain.place.value for drain in self._farm.workers.drains())
        except Exception:  # the store is unreachable: report the rest
            log.exception("The farm gave no snapshot")
            snapshot, drained = {}, Counts()
        text = "The store took this long for the figures of this scrape."
        yield _single("impasto_store_answer_seconds", text, time.perf_counter() - began)
        yield from _ready(snapshot.get("ready") or self._farm.ready())
        if snapshot:
            yield from _families(snapshot)
            places = {place.value: float(drained[place.value]) for place in DrainScope}
            yield _gauge("impasto_drained", "Places that an operator lets start nothing new.", "place", places)


def _ready(parts: Mapping[str, str]) -> Iterator[Metric]:
    words = {part: float(word == "ok") for part, word in parts.items()}
    yield _gauge("impasto_ready", "1 where a part of the farm works.", "part", words)


def _families(snapshot: Json) -> Iterator[Metric]:
    queue = snapshot.get("queue", {})
    yield _gauge("impasto_jobs", "Jobs.", "state", snapshot.get("jobs", {}))
    yield _gauge("impasto_tasks", "Tasks of all jobs.", "state", snapshot.get("tasks", {}))
    yield _single("impasto_queue_ready_tasks", "Tasks that could run now.", queue.get("ready_tasks", 0))
    yield _single("impasto_queue_oldest_seconds", "Wait of the oldest queued job.", queue.get("oldest_s", 0))
    yield _single("impasto_attempts_running", "Attempts at work.", snapshot.get("attempts_running", 0))
    yield _gauge(
        "impasto_recent_attempt_failures",
        "Attempts that failed in the last quarter of an hour.",
        "code",
        snapshot.get("failures", {}),
    )
    yield _gauge(
        "impasto_frames_per_second",
        "Frames finished a second, lately.",
        "method",
        snapshot.get("frames_per_s", {}),
    )
    yield from _workers(snapshot.get("pool", {}))
    yield from _totals(snapshot.get("totals", {}))
    yield from _reports(snapshot.get("totals", {}).get("reports", {}))
    yield _single("impasto_webhooks_waiting", "Messages in the outbox.", snapshot.get("webhooks_waiting", 0))


def _workers(pool: Json) -> Iterator[Metric]:
    """Worker processes of this process: existing, configured and busy."""
    here = int(pool.get("workers", 0))
    yield _single("impasto_workers", "Workers that are there.", here)
    yield _single("impasto_workers_wanted", "Workers that there should be.", int(pool.get("wanted", here)))
    yield _single("impasto_workers_busy", "Workers with an attempt at hand.", len(pool.get("busy", {})))


def _totals(totals: Mapping[str, Mapping[str, float]]) -> Iterator[Metric]:
    """Counters of this process, for rates over any window."""
    for name, text, label, key in (
        ("impasto_attempts", "Attempts that ended.", "outcome", "attempts"),
        ("impasto_attempt_failures", "Attempts that failed.", "code", "failures"),
        ("impasto_frames", "Frames finished.", "method", "frames"),
        ("impasto_attempt_seconds", "Wall time of attempts that ended.", "method", "busy_s"),
    ):
        family = CounterMetricFamily(name, text, labels=[label])
        for value, number in sorted(totals.get(key, {}).items())[:MAX_LABELS]:
            family.add_metric([value], float(number))
        yield family


def _reports(reports: Mapping[str, Mapping[str, Sequence[float]]]) -> Iterator[Metric]:
    """Quality reports of finished jobs: the mean over any window is the rate of the sum by that of the count."""
    for measure, rows in sorted(reports.items()):
        family = SummaryMetricFamily(
            f"impasto_quality_{measure}", f"{measure} of quality reports, see docs/quality.md.", labels=["method"]
        )
        for method, (count, total) in sorted(rows.items())[:MAX_LABELS]:
            family.add_metric([method], count_value=int(count), sum_value=float(total))
        yield family


def _gauge(name: str, text: str, label: str, values: Mapping[str, float]) -> Metric:
    family = GaugeMetricFamily(name, text, labels=[label])
    for value, number in sorted(values.items())[:MAX_LABELS]:
        family.add_metric([value], float(number))
    return family


def _single(name: str, text: str, value: float) -> Metric:
    return GaugeMetricFamily(name, text, value=float(value))
