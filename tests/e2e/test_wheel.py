"""The wheel alone, in a fresh environment: from `pip wheel` to a picture, without a network and without the checkout.

Dependencies come from the environment that runs the tests, without those of the extras for farms of several machines.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import httpx
import pytest

from impasto import Client
from pipeline.video.probe import probe
from service import bundle
from tests.conftest import ROOT
from tests.processes import started

pytestmark = pytest.mark.slow
PACKAGES = ("impasto", "service", "workers", "pipeline")
HIDDEN = ("ray", "boto3", "psycopg")


@pytest.fixture(scope="module")
def wheel(pages: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel of this checkout, built in a copy of its tracked files and its built pages."""
    source, out = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("wheel")
    for name in _tracked(*PACKAGES, "client", "pyproject.toml", "setup.py", "README.md", "LICENSE", "NOTICE"):
        (source / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / name, source / name)
    shutil.copytree(pages, source / "service" / "web" / "dist")
    options = ["--no-deps", "--no-build-isolation", "-q", "-w", str(out)]
    command = [sys.executable, "-m", "pip", "wheel", ".", "./client", *options]
    subprocess.run(command, cwd=source, check=True, env=_environment())
    (found,) = out.glob("impasto-*.whl")
    return found


@pytest.fixture(scope="module")
def environment(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of programs of an environment with the wheel, made by `venv`."""
    folder = tmp_path_factory.mktemp("environment")
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(folder)], check=True)
    python = folder / "bin" / "python"
    install = [sys.executable, "-m", "pip", "--python", str(python), "install"]
    options = ["--no-index", "--no-deps", "--no-compile", "-q"]  # Python compiles what is imported
    subprocess.run([*install, *options, *map(str, wheel.parent.glob("*.whl"))], check=True, env=_environment())
    (packages,) = (folder / "lib").glob("python*/site-packages")
    (packages / "dependencies.pth").write_text(sysconfig.get_paths()["purelib"] + "\n")
    (packages / "sitecustomize.py").write_text(f"import sys\nfor name in {HIDDEN}:\n    sys.modules[name] = None\n")
    return folder / "bin"


def test_the_wheel_has_every_file_of_the_packages(wheel: Path) -> None:
    names = set(zipfile.ZipFile(wheel).namelist())
    needed = {name for name in _tracked(*PACKAGES) if not name.startswith("service/web/")}
    needed |= {f"service/web/dist/{page}" for page in bundle.PAGES}
    assert needed - names == set()
    assert not [name for name in names if name.startswith("service/web/") and "/dist/" not in name]
    assert wheel.stat().st_size < 8 << 20


def test_render_writes_a_video(environment: Path, tmp_path: Path) -> None:
    _run(environment, tmp_path, "impasto", "scene", "harbour", "-o", "clip.mp4", "--frames", "6", "--size", "160x90")
    _run(environment, tmp_path, "impasto", "render", "clip.mp4", "-o", "cartoon.mp4")
    info = probe(tmp_path / "cartoon.mp4")
    assert (info.frames, info.width, info.height) == (6, 160, 90)
    where = _run(environment, tmp_path, "python", "-c", "import impasto; print(impasto.__file__)")
    assert where.startswith(str(environment.parent)), "the installed package runs, not the checkout"


def test_the_service_has_its_pages_and_runs_a_job(environment: Path, tmp_path: Path, tiny_clip: Path) -> None:
    with _service(environment, tmp_path) as url, httpx.Client(base_url=url, timeout=120) as http, Client(url) as client:
        for page in ("/", "/live", "/ops", "/docs", "/docs/docs.js", "/docs/docs.css", "/openapi.json"):
            assert http.get(page).status_code == 200, page
        for name in http.get("/").text.split('"'):
            assert not name.startswith("/static/") or http.get(name).status_code == 200, name
        assert {method["name"] for method in client.methods()} >= {"abstraction", "multistyle", "patches", "analogy"}
        job = client.submit("abstraction", {"video": client.upload(tiny_clip)["id"]})
        client.wait(job["id"])
        client.download(job["id"], tmp_path / "cartoon.mp4")
    assert probe(tmp_path / "cartoon.mp4").frames == 24


def test_a_missing_extra_is_named_with_its_remedy(environment: Path, tmp_path: Path) -> None:
    command = [str(environment / "impasto"), "serve", "--farm", "ray", "--home", "home"]
    done = subprocess.run(command, cwd=tmp_path, env=_environment(), capture_output=True, text=True, timeout=60)
    assert done.returncode
    assert "impasto[cluster]" in done.stderr.replace("\n", " ")


@contextmanager
def _service(environment: Path, folder: Path) -> Iterator[str]:
    command = [str(environment / "impasto"), "serve", "--port", "0", "--home", str(folder / "home")]
    with started(command, cwd=folder, env=_environment(), stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        yield process.stdout.readline().strip()


def _run(environment: Path, folder: Path, program: str, *words: str) -> str:
    command = [str(environment / program), *words]
    done = subprocess.run(command, cwd=folder, env=_environment(), capture_output=True, text=True, timeout=240)
    assert done.returncode == 0, done.stderr
    return done.stdout


def _environment() -> dict[str, str]:
    """Ours, without what leads Python to this checkout."""
    return {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "VIRTUAL_ENV")}


def _tracked(*paths: str) -> list[str]:
    """Files of the repository, also new ones that git does not ignore."""
    command = ["git", "ls-files", "--cached", "--others", "--exclude-standard", *paths]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout.splitlines()
