"""The client's wheel alone, in bare environments without NumPy and with the NumPy of Blender, against a real service.

Dependencies are copied from the environment that runs the tests, so that nothing else is there.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from tests.conftest import ROOT
from tests.ports import free_port
from tests.processes import started

HOST_NUMPY = "1.26.4"
"""Version in Blender 4.5 and 5.0."""
SCRIPT = """
import asyncio, json, sys
import impasto_client
from impasto_client import AsyncClient, BadParameter, Client, NotFound

server, clip, out = sys.argv[1:4]

async def again():
    async with AsyncClient(server) as client:
        asset = await client.upload(clip)
        job = await client.submit("abstraction", {"video": asset["id"]}, {"lines": "off"}, idempotency_key="one")
        seen = [event.type async for event in client.events(job["id"])]
        await client.wait(job["id"])
        await client.download(job["id"], out + ".async")
        return job["id"], seen

with Client(server) as client:
    asset, reports = client.upload(clip), []
    job = client.submit("abstraction", {"video": asset["id"]}, {"lines": "off"}, idempotency_key="one")
    client.wait(job["id"])
    client.download(job["id"], out, progress=lambda done, total: reports.append((done, total)))
    other, seen = asyncio.run(again())
    assert other == job["id"] and "job.state" in seen
    try:
        client.submit("abstraction", {"video": asset["id"]}, {"line": "off"})
    except BadParameter as error:
        field = error.field
    try:
        client.projects.get("prj_none")
    except NotFound as error:
        code = error.code
    project = client.projects.create("Swan")
    client.projects.change(project["id"], {"name": "Goose"}, project["version"])
    named = [each["name"] for each in client.projects.mine()]
    labels = client.jobs(label="shot:1")
    frames = None
    if "numpy" in sys.argv[4:]:
        import numpy
        from impasto_client.frames import write_frames
        image = numpy.full((48, 64, 4), 0.5, numpy.float32)
        write_frames(out + ".zip", [image] * 3, fps=12)
        frames = [numpy.__version__, client.upload(out + ".zip")["info"]["frames"]]
print(json.dumps([reports[-1], field, code, named, labels, frames, "pydantic" in sys.modules, impasto_client.__file__]))
"""


INSTALL = (sys.executable, "-m", "pip", "install", "--no-deps", "--no-compile", "-q")
"""Python compiles what is imported; to compile all of NumPy takes seconds."""


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    source = shutil.copytree(ROOT / "client", folder / "client", ignore=shutil.ignore_patterns("*.egg-info", "build"))
    options = ["--no-deps", "--no-build-isolation", "-q", "-w", str(folder)]
    subprocess.run([sys.executable, "-m", "pip", "wheel", str(source), *options], check=True)
    (found,) = folder.glob("*.whl")
    return found


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    home, port = tmp_path_factory.mktemp("home"), free_port()
    command = [sys.executable, "-m", "impasto", "serve", "--port", str(port), "--home", str(home)]
    with started(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        yield process.stdout.readline().strip()


def _environment(folder: Path, wheel: Path) -> Path:
    """Python of a new environment with the wheel and its dependencies; returns its interpreter."""
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(folder)], check=True)
    (packages,) = (folder / "lib").glob("python*/site-packages")
    subprocess.run([*INSTALL, "--no-index", "--target", str(packages), str(wheel)], check=True)
    for name in _closure("impasto-client") - {"impasto-client"}:
        for file in metadata.distribution(name).files or ():
            if ".." not in file.parts and "__pycache__" not in file.parts:
                target = packages / file
                target.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(str(file.locate()), target)
    return folder / "bin" / "python"


def _closure(name: str) -> set[str]:
    """Names of a distribution and all that it requires here."""
    found, left = set[str](), [name]
    while left:
        current = left.pop().lower()
        if current not in found:
            found.add(current)
            rows = [Requirement(row) for row in metadata.requires(current) or ()]
            left += [row.name for row in rows if row.marker is None or row.marker.evaluate({"extra": ""})]
    return found


def test_the_wheel_is_small_and_needs_few_packages(wheel: Path) -> None:
    assert wheel.stat().st_size < 100_000
    assert _closure("impasto-client") <= {
        "impasto-client", "httpx", "httpcore", "h11", "anyio", "idna", "certifi", "typing_extensions", "sniffio",
    }  # fmt: skip


def test_it_works_without_numpy(wheel: Path, address: str, tiny_clip: Path, tmp_path: Path) -> None:
    python = _environment(tmp_path / "bare", wheel)
    last, field, code, named, labels, frames, pydantic, where = _run(python, address, tiny_clip, tmp_path / "out.mp4")
    size = (tmp_path / "out.mp4").stat().st_size
    assert (last, field, code, named) == ([size, size], "params.line", "not-found", ["Goose"])
    assert (labels, frames, pydantic) == ([], None, False) and where.startswith(str(tmp_path))
    assert (tmp_path / "out.mp4.async").read_bytes() == (tmp_path / "out.mp4").read_bytes()
    assert subprocess.run([str(python), "-c", "import numpy"], capture_output=True).returncode


@pytest.mark.real("registry")
def test_it_works_beside_the_numpy_of_blender(wheel: Path, address: str, tiny_clip: Path, tmp_path: Path) -> None:
    python = _environment(tmp_path / "blender", wheel)
    (packages,) = (tmp_path / "blender" / "lib").glob("python*/site-packages")
    subprocess.run([*INSTALL, "--target", str(packages), f"numpy=={HOST_NUMPY}"], check=True)
    assert _run(python, address, tiny_clip, tmp_path / "out.mp4", "numpy")[5] == [HOST_NUMPY, 3]


def _run(python: Path, *words: object) -> list[object]:
    env = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "VIRTUAL_ENV")}
    command = [str(python), "-c", SCRIPT, *map(str, words)]
    done = subprocess.run(command, env=env, capture_output=True, text=True, timeout=240)
    assert done.returncode == 0, done.stderr
    found: list[object] = json.loads(done.stdout)
    return found
