"""The Blender extension: what needs no Blender, and all of it in a real one, if a Python with bpy is named.

python3.11 -m venv /tmp/blender && /tmp/blender/bin/pip install bpy==4.5.*      # or bpy==5.* with Python 3.13
IMPASTO_BPY=/tmp/blender/bin/python pytest tests/integrations/test_blender.py
"""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
import zipfile
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

from impasto_client import BadInput, BadParameter, Client
from tests.conftest import ROOT
from tests.ports import free_port

FOLDER = ROOT / "integrations" / "blender"
BPY = os.environ.get("IMPASTO_BPY", "")


def _module(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module
    spec.loader.exec_module(module)
    return module


work = _module(FOLDER / "impasto_blender" / "work.py")


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    home, port = tmp_path_factory.mktemp("home"), free_port()
    command = [sys.executable, "-m", "impasto", "serve", "--port", str(port), "--home", str(home)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            yield process.stdout.readline().strip()
        finally:
            process.terminate()
            process.wait(60)


def test_parameters_are_json_or_text() -> None:
    assert work.parsed_params('lines=off detail=0.5 on=true names=["a"]') == {
        "lines": "off", "detail": 0.5, "on": True, "names": ["a"],
    }  # fmt: skip
    with pytest.raises(BadParameter, match="name=value"):
        work.parsed_params("lines")


def test_rendered_frames_are_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    for name in ("b.0010.exr", "b.0009.exr", "notes.txt", ".b.0008.exr", "b.exr"):
        (tmp_path / name).touch()
    assert [path.name for path in work.rendered(tmp_path)] == ["b.0009.exr", "b.0010.exr"]


def test_the_same_frames_are_the_same_upload(tmp_path: Path) -> None:
    frame = tmp_path / "a.0001.png"
    frame.write_bytes(b"picture")
    work.zip_pictures([frame], tmp_path / "one.zip", 24)
    os.utime(frame, (0, 0))
    work.zip_pictures([frame], tmp_path / "two.zip", 24)
    assert (tmp_path / "one.zip").read_bytes() == (tmp_path / "two.zip").read_bytes()


def test_painted_frames_never_replace_files(tmp_path: Path) -> None:
    archive = tmp_path / "result.zip"
    with zipfile.ZipFile(archive, "w") as result:
        result.writestr("clip.1001.png", b"one")
        result.writestr("clip.1002.png", b"two")
    out = tmp_path / "out"
    assert [path.name for path in work.unpacked(archive, out)] == ["painted.1001.png", "painted.1002.png"]
    (out / "painted.1001.png").unlink()
    with pytest.raises(BadInput, match="nothing was overwritten"):
        work.unpacked(archive, out)
    assert [path.name for path in out.iterdir()] == ["painted.1002.png"]


def test_a_painting_ends_with_the_sentence_of_the_service(address: str, tmp_path: Path) -> None:
    order = work.Order(address, "", [], 24, "abstraction", {}, {}, tmp_path / "out")
    painting = work.Painting(order).start()
    painting.wait(30)
    assert "There are no rendered frames" in painting.error and not (tmp_path / "out").exists()


@pytest.mark.skipif(not BPY, reason="IMPASTO_BPY does not name a Python with bpy (CI installs none: 950 MB)")
def test_a_scene_is_rendered_painted_and_shown_in_the_compositor(address: str, tmp_path: Path) -> None:
    extension = _module(FOLDER / "build.py").build(tmp_path / "extension.zip")
    script = Path(__file__).with_name("in_blender.py")
    env = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "VIRTUAL_ENV")}
    env["BLENDER_USER_RESOURCES"] = str(tmp_path / "user")
    folder = tmp_path / "shot"
    folder.mkdir()
    done = subprocess.run(
        [BPY, str(script), str(extension), address, str(folder)], env=env, capture_output=True, text=True, timeout=240
    )
    assert done.returncode == 0, done.stdout + done.stderr
    found = json.loads(done.stdout.rpartition("RESULT ")[2].splitlines()[0])
    assert set(map(tuple, found["said"].values())) == {("FINISHED",)}
    assert found["passes"] == [True] * 4 and found["format"] == "PNG"
    assert found["node"] == [1001, 4, 1000, [96, 64], "SEQUENCE"]
    assert found["viewer"] == 1 and found["mine"] == [40, 80]
    assert "Did you mean 'lines'?" in found["refused"] and "no file" in found["unwritten"]
    painted = folder / "impasto" / "painted-001"
    with (
        Client(address) as client,
        zipfile.ZipFile(client.download(client.jobs()[0]["id"], tmp_path / "job.zip")) as job,
    ):
        pictures = {Path(name).name.rpartition(".")[0][-4:]: job.read(name) for name in job.namelist() if "png" in name}
    assert {path.stem[-4:]: path.read_bytes() for path in painted.iterdir()} == pictures
    assert sorted(pictures) == ["1001", "1002", "1003", "1004"]
