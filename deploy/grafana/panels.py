"""Data types and shared queries for declaring dashboards."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Line:
    """One query of a panel."""

    expr: str
    """PromQL; `$instance` is the dashboard's variable, the instances that the reader has selected."""
    legend: str = ""


@dataclass(frozen=True)
class Panel:
    title: str
    lines: tuple[Line, ...]
    text: str
    """Description: what the panel shows, and how to interpret unusual values."""
    unit: str = "short"
    """A unit as Grafana names it."""
    kind: Literal["timeseries", "stat"] = "timeseries"
    stacked: bool = False
    limits: tuple[tuple[float, str], ...] = ()
    """(lower bound, colour) of each range of values; red begins at the threshold of the alert."""
    low_is_bad: bool = False
    """Values below the first limit are red."""
    width: int = 0


@dataclass(frozen=True)
class Board:
    name: str
    title: str
    text: str
    groups: tuple[tuple[str, tuple[Panel, ...]], ...]


def graph(title: str, text: str, unit: str, *lines: Line, **more: object) -> Panel:
    return Panel(title, lines, text, unit, **more)  # type: ignore[arg-type]


def stat(title: str, text: str, unit: str, expr: str, **more: object) -> Panel:
    return Panel(title, (Line(expr),), text, unit, "stat", **more)  # type: ignore[arg-type]


def quantiles(metric: str, where: str = "") -> tuple[Line, ...]:
    """p50, p95 and p99 of a histogram over every process."""
    rate = f"sum by (le) (rate({metric}_bucket{{{where}}}[$__rate_interval]))"
    return tuple(Line(f"histogram_quantile({q}, {rate})", f"p{round(100 * q)}") for q in (0.5, 0.95, 0.99))


ONE = 'instance=~"$instance"'
RATE = "[$__rate_interval]"
BAD = ((1.0, "red"),)
ASKED = f'{ONE}, route!~".*(uploads|assets|previews|frame|thumbnail|result|files|content|regions|metrics|readyz).*"'
"""Short requests, selected as in the alert ImpastoSlow: without uploads and images, which take long by nature."""
