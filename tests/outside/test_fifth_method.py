"""A method that another package registers is listed, served, tested, measured and documented like a built-in one."""

from __future__ import annotations

import json
import subprocess
import sys
import zipfile
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from impasto import Client
from pipeline.video.reader import VideoReader
from tests.outside.conftest import ROOT


def run(environment: dict[str, str], *words: str) -> str:
    """The standard output of `python WORDS...`."""
    done = subprocess.run([sys.executable, *words], cwd=ROOT, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture
def impasto(address: str) -> Iterator[Client]:
    """A client of a service in that environment."""
    with Client(address) as client:
        yield client


def test_an_external_method_is_listed_with_its_schema(impasto: Client) -> None:
    assert [method["name"] for method in impasto.methods()][-1] == "posterize"
    found = impasto.method("posterize")
    tones = found["params_schema"]["properties"]["tones"]
    assert (tones["title"], tones["unit"], tones["minimum"], tones["maximum"], tones["default"]) == (
        "Tones", "levels", 2, 64, 4,
    )  # fmt: skip


def test_a_job_of_an_external_method_over_http_gives_its_frames(
    impasto: Client, tiny_clip: Path, tmp_path: Path
) -> None:
    video = impasto.upload(tiny_clip)["id"]
    job = impasto.submit("posterize", {"video": video}, {"tones": 2}, output={"format": "png"})
    impasto.wait(job["id"], timeout_s=60)
    impasto.download(job["id"], tmp_path / "frames.zip")
    with VideoReader(tiny_clip) as reader, zipfile.ZipFile(tmp_path / "frames.zip") as archive:
        for frame, name in zip(reader.read(), archive.namelist(), strict=True):
            painted = cv2.imdecode(np.frombuffer(archive.read(name), np.uint8), cv2.IMREAD_COLOR)
            assert painted is not None
            np.testing.assert_array_equal(painted[..., ::-1], np.where(frame < 128, 64, 192))


def test_the_command_explains_an_external_method(installed: dict[str, str]) -> None:
    found = json.loads(run(installed, "-m", "impasto", "methods", "posterize", "--json"))
    assert (found["title"], [each["name"] for each in found["params"]]) == ("Posterize", ["tones"])


def test_the_tests_of_every_method_cover_an_external_method(installed: dict[str, str]) -> None:
    """These tests include equal bytes in any order of tasks, and any frame count that the container claims."""
    suite = "tests/pipeline/methods/test_registry.py"
    printed = run(installed, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-k", "posterize", "-rp", suite)
    assert "test_the_same_request_gives_the_same_bytes_in_any_order[posterize]" in printed


def test_an_external_method_has_a_row_in_the_benchmark(installed: dict[str, str]) -> None:
    printed = run(installed, "-m", "benchmarks.methods", "--size", "64x48", "--frames", "2", "--turns", "1")
    assert [line.split(" | ")[0] for line in printed.splitlines()][-1] == "| posterize"


def test_an_external_method_has_a_row_in_the_documentation(installed: dict[str, str]) -> None:
    printed = run(installed, "-m", "docs.parameters", "--print")
    assert "| `posterize` | The video with fewer tones. |" in printed
    assert "## Posterize: `posterize`" in printed
