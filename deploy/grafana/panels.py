"""The words that dashboards are said in."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Line:
    """One query of a panel."""

    expr: str
    """PromQL; `$instance` is what the reader has chosen."""
    legend: str = ""


@dataclass(frozen=True)
class Panel:
    title: str
    lines: tuple[Line, ...]
    text: str
    """What it tells, and what to think when it looks odd."""
    unit: str = "short"
    """Grafana's name of a unit."""
    kind: Literal["timeseries", "stat"] = "timeseries"
    stacked: bool = False
    limits: tuple[tuple[float, str], ...] = ()
    """(from this value on, colour): where alerts begin."""
    low_is_bad: bool = False
    """Below the first limit it is red."""
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
"""Questions, as the alert ImpastoSlow has them: uploads and pictures are work."""
