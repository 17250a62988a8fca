"""The ComfyUI nodes: graphs run against a real service, over a stand-in of ComfyUI and in a real one if one is named.

IMPASTO_COMFYUI=/path/to/ComfyUI IMPASTO_COMFYUI_PYTHON=/path/to/its/python pytest tests/integrations/test_comfyui.py
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from impasto_client import Client
from impasto_client.frames import read_frames
from tests.conftest import ROOT
from tests.ports import free_port
from tests.processes import started

PACK = ROOT / "integrations" / "comfyui" / "impasto_comfyui"
SCRIPT = Path(__file__).with_name("in_comfyui.py")
REAL = os.environ.get("IMPASTO_COMFYUI", "")
STAND_IN = SCRIPT.with_name("comfyui")


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    home, port = tmp_path_factory.mktemp("home"), free_port()
    command = [sys.executable, "-m", "impasto", "serve", "--port", str(port), "--home", str(home)]
    with started(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        yield process.stdout.readline().strip()


@pytest.fixture(scope="module", params=["stand-in", "ComfyUI"])
def ran(request: pytest.FixtureRequest, address: str, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What the graphs of in_comfyui.py did; "folder" has their pictures."""
    real = request.param == "ComfyUI"
    if real and not REAL:
        pytest.skip("IMPASTO_COMFYUI does not name a ComfyUI (its torch has 4 GB)")
    folder = tmp_path_factory.mktemp("graphs")
    pack = shutil.copytree(PACK, folder / "custom_nodes" / PACK.name, ignore=shutil.ignore_patterns("methods.json"))
    python = os.environ["IMPASTO_COMFYUI_PYTHON"] if real else sys.executable
    with Client(address) as client:
        before = {job["id"] for job in client.jobs()}
    env = _environment(REAL if real else str(STAND_IN), address)
    command = [python, str(SCRIPT), str(pack), str(folder)]
    done = subprocess.run(command, env=env, cwd=folder, capture_output=True, text=True, timeout=400)
    assert done.returncode == 0, done.stdout + done.stderr
    found: dict[str, Any] = json.loads(done.stdout.rpartition("RESULT ")[2].splitlines()[0])
    return {**found, "folder": folder, "before": before}


def _environment(comfyui: str, server: str) -> dict[str, str]:
    path = os.pathsep.join([comfyui, str(ROOT / "client")])
    return {**os.environ, "IMPASTO_SERVER": server, "PYTHONPATH": path}


def test_each_method_of_the_service_is_a_node(ran: dict[str, Any], address: str) -> None:
    with Client(address) as client:
        assert ran["nodes"] == sorted(f"Impasto_{method['name']}" for method in client.methods())


def test_inputs_and_parameters_are_those_of_the_schema(ran: dict[str, Any], address: str) -> None:
    with Client(address) as client:
        methods = client.methods()
    for method in methods:
        declared = ran["inputs"][f"Impasto_{method['name']}"]
        for given in method["inputs"]:
            kind = declared["required" if given["required"] else "optional"][given["name"]][0]
            assert kind == ("STRING" if given["kind"] == "json" else "IMAGE")
        for name, schema in method["params_schema"]["properties"].items():
            kind, options = declared["optional"][name]
            usual = method["defaults"][name]
            assert options["default"] == (", ".join(usual) if isinstance(usual, list) else usual)
            assert (options.get("min"), options.get("max")) == (schema.get("minimum"), schema.get("maximum"))
            kinds = {"number": "FLOAT", "integer": "INT", "string": "STRING", "array": "STRING"}
            only = "number" if "varies" in schema else schema["type"]  # values over time have no widget
            assert kind == schema.get("enum", kinds[only])
        presets = declared["required"]["frames_per_second"][1]["presets"]
        assert set(presets) == {"default", *(each["name"] for each in method["examples"])}
        assert presets["default"] == {name: declared["optional"][name][1]["default"] for name in method["defaults"]}


def test_a_graph_paints_the_frames_that_the_service_paints(ran: dict[str, Any], address: str, tmp_path: Path) -> None:
    assert (ran["first"]["ran"], ran["first"]["fault"]) == (["1", "2", "3"], "")
    assert ran["first"]["progress"] == sorted(ran["first"]["progress"]) and ran["first"]["progress"][-1] == 1
    kept = np.load(ran["folder"] / "first.npz")
    report = ran["reports"]["first"]
    job_id = report.rpartition(" ")[2]
    with Client(address) as client:
        request = client.job(job_id)["request"]
        painted = np.stack(list(read_frames(client.download(job_id, tmp_path / "job.zip"))))
    assert (request["params"]["lines"], request["seed"], report) == ("off", 1, f"6 frames, job {job_id}")
    assert request["params"]["palette"] == ["#203040", "#e0d0c0"]
    assert kept["images"].dtype == np.float32 and kept["images"].shape == (6, 64, 96, 3)
    assert np.array_equal(kept["images"], painted.astype(np.float32) / 255) and not kept["mask"].any()


def test_a_node_runs_again_only_if_something_changed(ran: dict[str, Any]) -> None:
    assert (ran["again"]["ran"], ran["again"]["fault"]) == ([], "")
    assert ran["seed"]["ran"] == ["2", "3"]


def test_values_that_the_method_does_not_have_are_refused(ran: dict[str, Any]) -> None:
    assert "dashed" in ran["value"]["refused"] and "vividness" in ran["limit"]["refused"]


def test_a_style_and_keys_are_pictures_of_the_graph(ran: dict[str, Any], address: str) -> None:
    assert ({"2", "3", "4", "5"} <= set(ran["keys"]["ran"]), ran["keys"]["fault"]) == (True, "")
    images = np.load(ran["folder"] / "keys.npz")["images"]
    key = np.full((64, 96, 3), (0.1, 0.3, 0.5), np.float32)
    key[20:44, 10:34] = (0.3, 0.7, 0.2)
    assert np.abs(images[0] - key).max() <= 0.5 / 255 + 1e-6
    with Client(address) as client:
        job = client.job(ran["reports"]["keys"].splitlines()[0].rpartition(" ")[2])["request"]
    assert set(job["inputs"]) == {"video", "style_output", "keyframes"} and job["params"]["guide_weight"] == 1.5
    assert "Give 2 different numbers" in ran["numbers"]["fault"]


def test_a_branch_that_is_not_chosen_is_not_painted(ran: dict[str, Any]) -> None:
    assert (ran["lazy"]["fault"], "2" in ran["lazy"]["ran"]) == ("", False)


def test_an_interrupted_graph_cancels_its_job(ran: dict[str, Any], address: str) -> None:
    assert ran["interrupted"]["fault"] == "execution_interrupted"
    with Client(address) as client:
        states = [job["state"] for job in client.jobs() if job["id"] not in ran["before"]]
    assert states.count("cancelled") == 1 and set(states) == {"cancelled", "succeeded"}


def test_saved_graphs_have_their_nodes_while_the_service_is_away(ran: dict[str, Any]) -> None:
    pack = ran["folder"] / "custom_nodes" / PACK.name
    script = f"import nodes\nassert nodes.load_custom_node({str(pack)!r})\nprint(len(nodes.NODE_CLASS_MAPPINGS))"
    env = _environment(str(STAND_IN), f"http://127.0.0.1:{free_port()}")
    command = [sys.executable, "-c", script]
    done = subprocess.run(command, env=env, capture_output=True, text=True, timeout=60)
    assert int(done.stdout) == len(ran["nodes"]) and "No answer" in done.stderr
    (pack / "methods.json").unlink()
    done = subprocess.run(command, env=env, capture_output=True, text=True, timeout=60)
    assert (done.stdout.strip(), done.returncode) == ("0", 0) and "impasto serve" in done.stderr
