"""deploy/compose.yaml is checked against the Compose specification and the files that it references."""

from __future__ import annotations

import json
import os
import re
import subprocess
from pathlib import Path
from typing import Any

import pytest
import yaml

from service.settings import Settings
from tests.deploy.dockerfile import stages

DEPLOY = Path(__file__).resolve().parents[2] / "deploy"
TEXT = (DEPLOY / "compose.yaml").read_text()
SECRETS = dict.fromkeys(re.findall(r"^(?!PREFIX)([A-Z_0-9]+)=$", (DEPLOY / "env.example").read_text(), re.M), "s3cret")
GIVEN = dict(re.findall(r"^([A-Z_0-9]+)=(.*)$", (DEPLOY / "env.example").read_text(), re.M)) | SECRETS
_VARIABLE = re.compile(r"\$\{(\w+)(?::([-?])([^}]*))?\}")


def filled(text: str, given: dict[str, str]) -> str:
    """The file with its variables substituted as by Compose. Raises KeyError if a required variable is missing."""

    def value(match: re.Match[str]) -> str:
        name, how, rest = match.groups()
        if given.get(name):
            return given[name]
        if how == "-":
            return str(rest)
        if how == "?":
            raise KeyError(name)
        return given[name]

    return _VARIABLE.sub(value, text)


@pytest.fixture(scope="module")
def services() -> dict[str, Any]:
    return dict(yaml.safe_load(filled(TEXT, GIVEN))["services"])


def test_it_matches_the_specification() -> None:
    from compose_spec import PyCompose  # 0.3 s, which every process of the suite would spend

    found = PyCompose.from_yaml(yaml.safe_dump(yaml.safe_load(filled(TEXT, GIVEN))))
    names = {"postgres", "s3", "bucket", "head", "worker", "service", "prometheus", "grafana"}
    assert set(found.service_names()) == names


def test_a_missing_secret_is_named() -> None:
    for name in SECRETS:
        with pytest.raises(KeyError, match=name):
            filled(TEXT, {**GIVEN, name: ""})


def test_every_variable_is_in_the_example_environment() -> None:
    assert {match[0] for match in _VARIABLE.findall(TEXT)} <= set(GIVEN)


def test_every_reference_between_services_resolves(services: dict[str, Any]) -> None:
    whole = yaml.safe_load(filled(TEXT, GIVEN))
    targets = stages(DEPLOY.parent / "docker" / "Dockerfile")
    for name, row in services.items():
        assert set(row.get("depends_on", ())) <= set(services), name
        assert set(row["networks"]) <= set(whole["networks"]), name
        assert row.get("build", {}).get("target", "worker") in targets, name
        for mount in row.get("volumes", ()):
            source = mount.split(":")[0]
            assert (DEPLOY / source).exists() if source.startswith(".") else source in whole["volumes"], mount
        for needed, how in _waits(row):
            assert how != "service_healthy" or _has_check(services[needed], targets), f"{name} waits for {needed}"


def _waits(row: dict[str, Any]) -> list[tuple[str, str]]:
    waits = row.get("depends_on", {})
    return [(name, how["condition"]) for name, how in waits.items()] if isinstance(waits, dict) else []


def _has_check(row: dict[str, Any], targets: dict[str, Any]) -> bool:
    return "healthcheck" in row or bool(targets[row["build"]["target"]].all("HEALTHCHECK"))


def test_containers_have_minimal_privileges(services: dict[str, Any]) -> None:
    for name, row in services.items():
        assert "privileged" not in row and "/var/run/docker.sock" not in str(row)
        assert "no-new-privileges:true" in row["security_opt"], name
        if name != "postgres":  # its entry point changes user
            assert row["read_only"] and row["cap_drop"] == ["ALL"], name
    assert yaml.safe_load(TEXT)["networks"]["farm"] == {"internal": True}
    outside = {name for name, row in services.items() if "front" in row["networks"]}
    assert outside == {"service", "prometheus", "grafana"}
    for row in services.values():
        assert all(str(port).startswith("127.0.0.1:") for port in row.get("ports", ()))


def test_image_names_contain_no_registry(services: dict[str, Any]) -> None:
    for row in services.values():
        name = row["image"]
        assert ":" in name and "." not in name.split("/")[0].split(":")[0]
    prefixed = yaml.safe_load(filled(TEXT, {**GIVEN, "PREFIX": "mirror.internal/"}))["services"]
    assert all(row["image"].startswith("mirror.internal/") for row in prefixed.values())


def test_the_compose_settings_exist_and_are_valid(services: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("service", "worker", "head", "bucket"):
        given = services[name]["environment"]
        for key, value in given.items():
            if key.startswith("IMPASTO_"):
                assert key.removeprefix("IMPASTO_").lower() in Settings.model_fields, key
                monkeypatch.setenv(key, GIVEN["IMPASTO_WEBHOOK_SECRET"] * 8 if "WEBHOOK" in key else str(value))
    settings = Settings()
    assert settings.url == "postgresql://impasto:s3cret@postgres/impasto"
    assert (settings.blob_url, settings.ray_address) == ("s3://impasto/farm", "head:6379")


def test_two_prometheus_configurations_agree() -> None:
    plain, ours = (
        yaml.safe_load((DEPLOY / "prometheus" / f"{name}.yml").read_text()) for name in ("prometheus", "compose")
    )
    assert ours["rule_files"] == plain["rule_files"] and ours["global"] == plain["global"]
    assert [job["job_name"] for job in ours["scrape_configs"]] == [job["job_name"] for job in plain["scrape_configs"]]
    names = {name for job in ours["scrape_configs"] for row in job.get("dns_sd_configs", ()) for name in row["names"]}
    assert names <= set(yaml.safe_load(TEXT)["services"])


@pytest.mark.real("compose")
def test_docker_compose_accepts_the_file(tmp_path: Path) -> None:
    """Debian's docker-compose needs no engine for this check; it substitutes variables itself."""
    given = tmp_path / "env"
    given.write_text("".join(f"{name}={value}\n" for name, value in GIVEN.items()))
    command = ["docker-compose", "--env-file", str(given), "-f", str(DEPLOY / "compose.yaml"), "config"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    theirs, ours = yaml.safe_load(done.stdout), yaml.safe_load(filled(TEXT, GIVEN))
    for name, row in ours["services"].items():
        assert theirs["services"][name]["image"] == row["image"]
        environment = {key: str(value) for key, value in row.get("environment", {}).items()}
        assert theirs["services"][name].get("environment", {}) == environment
    given.write_text("")
    empty = subprocess.run(command, capture_output=True, text=True, env={"PATH": os.environ["PATH"]})
    assert empty.returncode != 0 and "put it in deploy/.env" in empty.stderr


def test_the_s3_server_is_configured_with_the_given_keys(services: dict[str, Any], tmp_path: Path) -> None:
    (script,) = services["s3"]["command"]
    script = script.replace("$$", "$").replace("/tmp/", f"{tmp_path}/").replace("exec weed", "echo weed")
    env = {"PATH": os.environ["PATH"], **services["s3"]["environment"]}
    done = subprocess.run([*services["s3"]["entrypoint"], script], env=env, capture_output=True, text=True, check=True)
    assert done.stdout.startswith(f"weed server -s3 -dir=/data -s3.config={tmp_path}/s3.json")
    (identity,) = json.loads((tmp_path / "s3.json").read_text())["identities"]
    assert identity["credentials"] == [{"accessKey": "impasto", "secretKey": "s3cret"}]
    worker = services["worker"]["environment"]
    assert (worker["IMPASTO_S3_ACCESS_KEY"], worker["IMPASTO_S3_SECRET_KEY"]) == ("impasto", "s3cret")
