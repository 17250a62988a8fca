"""Generates deploy/grafana/dashboards/*.json: `python -m deploy.grafana.build`. A test compares files and output.

`deploy.grafana.boards` declares each panel in a few lines; this module expands the panels to Grafana's verbose format.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from deploy.grafana.boards import BOARDS
from deploy.grafana.panels import Board, Panel

HERE = Path(__file__).parent / "dashboards"
SOURCE = {"type": "prometheus", "uid": "impasto-prometheus"}
COLUMNS = 24


@dataclass
class _Place:
    """Position of the next panel: from left to right, then in the next row."""

    x: int = 0
    y: int = 0
    row: int = 0
    ids: int = field(default=0)

    def take(self, width: int, height: int) -> dict[str, int]:
        if self.x + width > COLUMNS:
            self.x, self.y, self.row = 0, self.y + self.row, 0
        spot = {"x": self.x, "y": self.y, "w": width, "h": height}
        self.x, self.row = self.x + width, max(self.row, height)
        return spot

    def next_id(self) -> int:
        self.ids += 1
        return self.ids


def render(board: Board) -> dict[str, Any]:
    """A board in Grafana's JSON format."""
    place = _Place()
    panels: list[dict[str, Any]] = []
    for title, group in board.groups:
        spot = place.take(COLUMNS, 1)
        panels.append({"id": place.next_id(), "type": "row", "title": title, "gridPos": spot, "collapsed": False})
        panels += [_panel(panel, place) for panel in group]
        place.x = COLUMNS
    return {
        "uid": f"impasto-{board.name}",
        "title": f"Impasto / {board.title}",
        "description": board.text,
        "tags": ["impasto"],
        "schemaVersion": 39,
        "version": 1,
        "editable": False,
        "graphTooltip": 1,
        "refresh": "30s",
        "time": {"from": "now-6h", "to": "now"},
        "timezone": "utc",
        "links": [_LINKS],
        "annotations": {"list": [_ALERTS]},
        "templating": {"list": [_INSTANCES]},
        "panels": panels,
    }


def _panel(panel: Panel, place: _Place) -> dict[str, Any]:
    stat = panel.kind == "stat"
    options: dict[str, Any] = (
        {"reduceOptions": {"calcs": ["lastNotNull"]}, "colorMode": "background", "graphMode": "area"}
        if stat
        else {"legend": {"displayMode": "list", "placement": "bottom"}, "tooltip": {"mode": "multi", "sort": "desc"}}
    )
    return {
        "id": place.next_id(),
        "type": panel.kind,
        "title": panel.title,
        "description": panel.text,
        "datasource": SOURCE,
        "gridPos": place.take(panel.width or (4 if stat else 8), 4 if stat else 8),
        "targets": [
            {"refId": "ABCDEFGH"[n], "datasource": SOURCE, "expr": line.expr, "legendFormat": line.legend or "__auto"}
            for n, line in enumerate(panel.lines)
        ],
        "fieldConfig": {"defaults": _defaults(panel), "overrides": []},
        "options": options,
    }


def _defaults(panel: Panel) -> dict[str, Any]:
    steps: list[dict[str, Any]] = [{"color": "green", "value": None}]
    steps += [{"color": colour, "value": at} for at, colour in panel.limits]
    found: dict[str, Any] = {"unit": panel.unit, "min": 0, "thresholds": {"mode": "absolute", "steps": steps}}
    if panel.low_is_bad:
        found["thresholds"]["steps"] = [
            {"color": "red", "value": None},
            *({"color": colour, "value": at} for at, colour in panel.limits),
        ]
    if panel.kind == "timeseries":
        stacking = {"mode": "normal" if panel.stacked else "none"}
        found["custom"] = {"lineWidth": 1, "fillOpacity": 30 if panel.stacked else 5, "stacking": stacking}
        if panel.limits:
            found["custom"]["thresholdsStyle"] = {"mode": "line"}
    return found


_LINKS = {"type": "dashboards", "title": "Impasto", "tags": ["impasto"], "asDropdown": False, "keepTime": True}
_ALERTS = {
    "name": "Alerts",
    "datasource": SOURCE,
    "enable": True,
    "iconColor": "red",
    "expr": 'ALERTS{alertname=~"Impasto.*", alertstate="firing"}',
    "titleFormat": "{{alertname}}",
    "textFormat": "{{instance}}",
}
_INSTANCES = {
    "name": "instance",
    "label": "Service",
    "type": "query",
    "datasource": SOURCE,
    "query": {"query": 'label_values(up{job="impasto"}, instance)', "refId": "instances"},
    "refresh": 2,
    "sort": 1,
    "multi": True,
    "includeAll": True,
    "allValue": ".*",
    "current": {"text": "All", "value": "$__all"},
}


def as_text(board: Board) -> str:
    return json.dumps(render(board), indent=2) + "\n"


def main() -> None:
    for board in BOARDS:
        (HERE / f"{board.name}.json").write_text(as_text(board))


if __name__ == "__main__":
    main()
