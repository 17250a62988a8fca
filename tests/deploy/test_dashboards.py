"""Dashboards and alerts as files: complete, valid for promtool, each alert with its section in the runbook."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.deploy.expressions import DASHBOARDS, DEPLOY, RULES, alerts, metrics_in, panels, shipped
from tests.real.prometheus import promtool

ROOT = DEPLOY.parent
SOURCE = {"type": "prometheus", "uid": "impasto-prometheus"}


@pytest.mark.parametrize("name", ["service", "farm", "live", "stores"])
def test_a_dashboard_is_named_after_its_file(name: str) -> None:
    (path,) = (each for each in DASHBOARDS if each.stem == name)
    board = json.loads(path.read_text())
    assert board["uid"] == f"impasto-{name}"
    (variable,) = board["templating"]["list"]
    assert (variable["name"], variable["datasource"]) == ("instance", SOURCE)


@pytest.mark.parametrize("board", DASHBOARDS, ids=lambda path: path.stem)
def test_a_dashboard_is_consistent(board: Path) -> None:
    found = panels(board)
    assert len({panel["id"] for panel in found}) == len(found)
    taken: set[tuple[int, int]] = set()
    for panel in found:
        spot = panel["gridPos"]
        cells = {
            (x, y) for x in range(spot["x"], spot["x"] + spot["w"]) for y in range(spot["y"], spot["y"] + spot["h"])
        }
        assert not cells & taken and spot["x"] + spot["w"] <= 24, panel["title"]
        taken |= cells
        if panel["type"] != "row":
            assert panel["description"] and panel["targets"], panel["title"]
            assert all(target["datasource"] == SOURCE for target in panel["targets"])


def test_the_data_source_is_provisioned_and_the_folder_is_mounted() -> None:
    sources = yaml.safe_load((DEPLOY / "grafana/provisioning/datasources/impasto.yml").read_text())
    assert [(row["uid"], row["type"]) for row in sources["datasources"]] == [(SOURCE["uid"], SOURCE["type"])]
    (provider,) = yaml.safe_load((DEPLOY / "grafana/provisioning/dashboards/impasto.yml").read_text())["providers"]
    mounts = yaml.safe_load((DEPLOY / "compose.yaml").read_text())["services"]["grafana"]["volumes"]
    assert any(mount.split(":")[:2] == ["./grafana/dashboards", provider["options"]["path"]] for mount in mounts)


@pytest.mark.parametrize("rule", alerts(), ids=lambda rule: str(rule["alert"]))
def test_an_alert_has_a_severity_and_a_runbook(rule: dict[str, Any]) -> None:
    assert rule["labels"]["severity"] in ("page", "ticket")
    assert rule["annotations"]["summary"].endswith(".")
    page, _, anchor = rule["annotations"]["runbook"].partition("#")
    assert anchor == rule["alert"].lower()
    section = re.search(rf"^## {rule['alert']}\n(.*?)(?=^## |\Z)", (ROOT / page).read_text(), re.M | re.S)
    assert section, f"{page} has no section {rule['alert']}"
    for word in ("**Meaning.**", "**Check.**", "**Remedy.**"):
        assert word in section[1], f"{rule['alert']}: {word}"


def test_the_runbook_has_no_section_for_a_removed_alert() -> None:
    titles = re.findall(r"^## (Impasto\w+)$", (ROOT / "docs/runbook.md").read_text(), re.M)
    assert sorted(titles) == sorted(rule["alert"] for rule in alerts())


def test_every_alert_has_a_firing_test() -> None:
    tests = yaml.safe_load((DEPLOY / "prometheus/alerts_test.yml").read_text())["tests"]
    fired = {row["alertname"] for test in tests for row in test["alert_rule_test"] if row.get("exp_alerts")}
    assert fired == {rule["alert"] for rule in alerts()}


def test_every_expression_names_an_exported_metric() -> None:
    assert all(metrics_in(expr) for expr in shipped().values())


@pytest.mark.real("prometheus")
def test_promtool_accepts_the_rules_and_their_tests_pass() -> None:
    assert f"{len(alerts())} rules found" in promtool("check", "rules", RULES)
    assert "SUCCESS" in promtool("test", "rules", DEPLOY / "prometheus" / "alerts_test.yml")


@pytest.mark.real("prometheus")
def test_promtool_accepts_the_dashboard_queries(tmp_path: Path) -> None:
    rules = [{"record": f"panel:{n}", "expr": expr} for n, expr in enumerate(shipped().values())]
    path = tmp_path / "panels.yml"
    path.write_text(yaml.safe_dump({"groups": [{"name": "panels", "rules": rules}]}))
    assert f"{len(rules)} rules found" in promtool("check", "rules", "--lint=none", path)


@pytest.mark.real("prometheus")
def test_promtool_accepts_the_configuration() -> None:
    assert "SUCCESS" in promtool("check", "config", "--syntax-only", DEPLOY / "prometheus" / "prometheus.yml")
