"""The PromQL expressions of dashboards and alerts, with their locations."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import yaml

DEPLOY = Path(__file__).resolve().parents[2] / "deploy"
DASHBOARDS = sorted((DEPLOY / "grafana" / "dashboards").glob("*.json"))
RULES = DEPLOY / "prometheus" / "rules" / "impasto.yml"
_NAME = re.compile(r"(?<![\w:])(?:impasto|process|ray|up|ALERTS)(?:_\w+)?(?!\w*\()")


def alerts() -> list[dict[str, Any]]:
    groups = yaml.safe_load(RULES.read_text())["groups"]
    return [rule for group in groups for rule in group["rules"]]


def panels(board: Path) -> list[dict[str, Any]]:
    return list(json.loads(board.read_text())["panels"])


def drawn() -> dict[str, str]:
    """Location -> expression of the dashboards, as Grafana queries it for all instances."""
    found: dict[str, str] = {}
    for board in DASHBOARDS:
        for panel in panels(board):
            for target in panel.get("targets", ()):
                where = f"{board.stem} {panel['type']}: {panel['title']} {target['refId']}"
                assert where not in found, where
                found[where] = target["expr"].replace("$instance", ".*").replace("$__rate_interval", "30s")
    return found


def shipped() -> dict[str, str]:
    """Location -> expression of dashboards and alerts."""
    return drawn() | {f"alert {rule['alert']}": rule["expr"] for rule in alerts()}


def metrics_in(expr: str) -> set[str]:
    """The metrics that an expression names."""
    bare = re.sub(r'"[^"]*"', '""', expr)
    return set(_NAME.findall(bare))
