"""What an attack does to the others: answers of /healthz and of another owner's listing, memory, threads."""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field

import httpx
import numpy as np
import psutil

from tests.abuse.attack import Attack, in_process
from tests.abuse.target import Target

HEALTH_S, LISTING_S, RSS_MIB = 0.5, 1.0, 1024
"""What the others must get at the 99th percentile, seconds; and the memory of the service."""
_ENDED_MIB = 3072
"""A service that takes more is killed, before it takes the memory of the machine."""
_PROBE_TIMEOUT_S, _PAUSE_S = 20.0, 0.05
_OURS = {*range(200, 500), 501, 503, 507}
"""Statuses that an abuse may get."""


@dataclass
class Found:
    """Of one attack. Times in seconds, memory in MiB."""

    name: str
    health_s: list[float] = field(default_factory=list)
    listing_s: list[float] = field(default_factory=list)
    rss_mib: float = 0.0
    threads: int = 0
    statuses: Counter[int] = field(default_factory=Counter)

    @property
    def faults(self) -> list[str]:
        """What is not as it must be."""
        wrong = [status for status in self.statuses if status not in _OURS and status]
        return [
            *([f"/healthz {p99(self.health_s):.2f} s"] if p99(self.health_s) > HEALTH_S else []),
            *([f"listing {p99(self.listing_s):.2f} s"] if p99(self.listing_s) > LISTING_S else []),
            *([f"{self.rss_mib:.0f} MiB"] if self.rss_mib > RSS_MIB else []),
            *([f"answers of {wrong}"] if wrong else []),
        ]


def p99(values: list[float]) -> float:
    return float(np.percentile(values, 99)) if values else float("inf")


def measured(made: Attack, target: Target, seconds: float) -> Found:
    """Run an attack for some seconds, and measure meanwhile and until the last probe is answered."""
    found, over = Found(made.name), threading.Event()
    probes = [
        threading.Thread(target=_probe, args=(target, "/healthz", found.health_s, over)),
        threading.Thread(target=_probe, args=(target, "/v1/jobs?limit=20", found.listing_s, over)),
        threading.Thread(target=_sample, args=(target.process, found, over)),
    ]
    process, result = in_process(made, target.place, seconds)
    for probe in probes:
        probe.start()
    try:
        found.statuses = result.recv() if result.poll(seconds + 60) else Counter({0: 1})
    except EOFError:
        found.statuses = Counter({0: 1})
    over.set()
    for probe in probes:
        probe.join()
    process.kill()
    process.join()
    return found


def settled(target: Target) -> bool:
    """Whether the service answers within 10 s, in a tenth of a second at last."""
    until = time.monotonic() + 10
    while time.monotonic() < until and target.process.is_running():
        with target.client(target.keys[1]) as http:
            if _timed(lambda http=http: http.get("/healthz", timeout=5)) < 0.1:
                return True
        time.sleep(0.1)
    return False


def _probe(target: Target, path: str, times: list[float], over: threading.Event) -> None:
    with target.client(target.keys[1]) as http:
        http.timeout = httpx.Timeout(_PROBE_TIMEOUT_S)
        while not over.is_set():
            times.append(_timed(lambda: http.get(path)))
            over.wait(_PAUSE_S)


def _timed(ask: Callable[[], httpx.Response]) -> float:
    """Seconds until a good answer; the timeout if there is none."""
    began = time.perf_counter()
    try:
        ask().raise_for_status()
    except httpx.HTTPError:
        return _PROBE_TIMEOUT_S
    return time.perf_counter() - began


def _sample(process: psutil.Process, found: Found, over: threading.Event) -> None:
    while not over.is_set():
        try:
            found.rss_mib = max(found.rss_mib, process.memory_info().rss / 2**20)
            found.threads = max(found.threads, process.num_threads())
            if found.rss_mib > _ENDED_MIB:
                process.kill()
        except psutil.Error:
            return
        over.wait(_PAUSE_S)
