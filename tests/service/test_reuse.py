"""A corrected project is rendered again: tasks that do not depend on the correction keep their results, over HTTP.

The video has two shots of 14 frames with a disc that moves before a wall; runs are frames 0 to 11, 12 to 13, and so on.
"""

from __future__ import annotations

import io
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import av
import cv2
import httpx
import numpy as np
import pytest

from service.settings import Settings
from tests.service.live import running
from workers.farm import open_farm

SIZE = (96, 64)
SHOT_FRAMES = 14
CORRECTED = SHOT_FRAMES + 13
"""A frame in the last run of the second shot."""
Json = dict[str, Any]


@contextmanager
def service(home: Path, **changes: Any) -> Iterator[httpx.Client]:
    settings = Settings(home=home, pool="local", workers=1, **changes)
    farm = open_farm(settings)
    farm.start()
    try:
        with running(settings, farm) as url, httpx.Client(base_url=url, timeout=60) as client:
            yield client
    finally:
        farm.stop()


@pytest.fixture(scope="module")
def http(tmp_path_factory: pytest.TempPathFactory) -> Iterator[httpx.Client]:
    """A client of a service that reuses results. To start one and load a method takes 3 s of a processor."""
    with service(tmp_path_factory.mktemp("reuses") / "home") as client:
        yield client


@pytest.fixture(scope="module")
def forgetful(tmp_path_factory: pytest.TempPathFactory) -> Iterator[httpx.Client]:
    """A client of a service that reuses nothing."""
    with service(tmp_path_factory.mktemp("forgets") / "home", reuse_s=0) as client:
        yield client


@pytest.fixture(scope="module")
def clip() -> bytes:
    return encoded((1, 2), SHOT_FRAMES)


def encoded(shots: tuple[int, ...], frames: int) -> bytes:
    """Shots of so many frames each."""
    out = io.BytesIO()
    with av.open(out, "w", format="matroska") as container:
        stream = container.add_stream("ffv1", rate=24)
        stream.width, stream.height, stream.pix_fmt = *SIZE, "bgr0"
        for shot in shots:
            wall = np.random.default_rng(shot).integers(60, 190, (16, 24 + frames, 3), np.uint8)
            wall = cv2.resize(wall, (8 * wall.shape[1] // 2, 64), interpolation=cv2.INTER_CUBIC)
            for index in range(frames):
                frame = np.ascontiguousarray(wall[:, index : index + SIZE[0]])
                cv2.circle(frame, (30 + 3 * index, 34), 14, (230, 120, 40) if shot == 1 else (30, 200, 60), -1)
                cv2.circle(frame, (27 + 3 * index, 30), 4, (20, 20, 20), -1)
                container.mux(stream.encode(av.VideoFrame.from_ndarray(frame, format="rgb24")))
        container.mux(stream.encode(None))
    return out.getvalue()


def upload(http: httpx.Client, data: bytes, name: str) -> str:
    return str(http.post("/v1/assets", files={"file": (name, data)}).json()["id"])


def document(video: str, **layer: Any) -> Json:
    return {
        "schema": 2,
        "name": "Two shots",
        "assets": {"clip": {"id": video}},
        "shots": [{"id": "s1", "video": "clip", "layers": [{"id": "l1", "method": "patches", **layer}]}],
        "output": {"format": "png", "artefacts": ["labels", "uncertainty"]},
    }


def corrected(http: httpx.Client, value: Json, labels: bytes) -> Json:
    """The document with a corrected label map that changes the last two frames."""
    image = {"map": {"id": upload(http, labels, "map.png")}}
    drawn = {"frame": CORRECTED, "image": "map", "solve": [CORRECTED - 1, CORRECTED + 1]}
    (shot,) = value["shots"]
    layers = [{**shot["layers"][0], "parts": {"labels": [drawn]}}]
    return {**value, "assets": {**value["assets"], **image}, "shots": [{**shot, "layers": layers}]}


def rendered(http: httpx.Client, project: str) -> Json:
    (item,) = http.post(f"/v1/projects/{project}/jobs", json={}).json()["items"]
    job: Json = item["job"]
    for _ in range(2400):
        job = http.get(f"/v1/jobs/{job['id']}").json()
        if job["state"] not in ("queued", "running"):
            break
        time.sleep(0.05)
    assert job["state"] == "succeeded", job["error"]
    return job


def film(http: httpx.Client, job: Json) -> bytes:
    found = http.get(f"/v1/jobs/{job['id']}/result")
    assert found.status_code == 200, found.text
    return found.content


def tasks(http: httpx.Client, job: Json) -> dict[str, bool]:
    """Task -> whether its result was reused."""
    items = http.get(f"/v1/jobs/{job['id']}/tasks", params={"limit": 200}).json()["items"]
    return {f"{task['step']}/{task['key']}": task["reused"] for task in items}


def true_labels() -> bytes:
    """The label map of the corrected frame: the wall is background, the disc an object that was not found."""
    image = np.ones(SIZE[::-1], np.uint16)
    cv2.circle(image, (30 + 3 * (CORRECTED - SHOT_FRAMES), 34), 14, 40, -1)
    return cv2.imencode(".png", image)[1].tobytes()


def test_a_correction_repeats_only_the_tasks_that_depend_on_it(
    clip: bytes, tmp_path: Path, forgetful: httpx.Client
) -> None:
    with service(tmp_path / "home") as http:
        value = document(upload(http, clip, "two.mkv"))
        project = http.post("/v1/projects", json={"document": value}).json()["id"]
        first = rendered(http, project)
        assert not any(tasks(http, first).values())
        drawn = true_labels()
        changed = corrected(http, value, drawn)
        http.put(f"/v1/projects/{project}", json=changed, headers={"If-Match": '"1"'}).raise_for_status()
    with service(tmp_path / "home") as http:  # results are kept over a restart
        second = rendered(http, project)
        found, film_of_both = tasks(http, second), film(http, second)
        assert film_of_both != film(http, first)
        counted = Counter(name.partition("/")[0] for name, reused in found.items() if reused)
        assert {step["name"]: step["reused"] for step in second["steps"] if step["reused"]} == counted
    ran = {name for name, reused in found.items() if not reused}
    start, half = f"{SHOT_FRAMES + 12:07d}", SHOT_FRAMES // 2  # a shot is painted in two runs of equal length
    of_first_shot = {name for name in found if "/s0000000-" in name} | {"paint/run-0000000", f"paint/run-{half:07d}"}
    assert not ran & {"scan/video", *of_first_shot}
    assert {name for name in ran if name.startswith(("cluster/", "correct/"))} == {
        f"correct/{which}" for which in (f"front-{start}-{start}", f"back-{start}-{start}", f"run-{start}")
    }
    painted = f"paint/run-{SHOT_FRAMES + half:07d}"
    assert {"scan/inputs", f"register/run-{start}", painted, "assemble/assemble"} <= ran
    value = corrected(forgetful, document(upload(forgetful, clip, "two.mkv")), drawn)
    whole = rendered(forgetful, forgetful.post("/v1/projects", json={"document": value}).json()["id"])
    assert not any(tasks(forgetful, whole).values())
    assert film(forgetful, whole) == film_of_both


def test_a_correction_does_not_register_other_runs_of_its_shot_again(http: httpx.Client) -> None:
    frames, at, solve = 48, 45, [44, 48]
    image = np.ones(SIZE[::-1], np.uint16)
    cv2.rectangle(image, (10, 10), (30, 50), 40, -1)
    value = document(upload(http, encoded((1,), frames), "one.mkv"))
    project = http.post("/v1/projects", json={"document": value}).json()["id"]
    rendered(http, project)
    value["assets"]["map"] = {"id": upload(http, cv2.imencode(".png", image)[1].tobytes(), "map.png")}
    value["shots"][0]["layers"][0].setdefault("parts", {})["labels"] = [{"frame": at, "image": "map", "solve": solve}]
    http.put(f"/v1/projects/{project}", json=value, headers={"If-Match": '"1"'}).raise_for_status()
    found = tasks(http, rendered(http, project))
    ran = {name for name, reused in found.items() if not reused}
    again = {name for name in ran if name.startswith(("cluster/", "correct/", "register/"))}
    last = "0000036"
    correct = {
        f"correct/{which}" for which in (f"front-{solve[0]:07d}-{last}", f"back-{solve[0]:07d}-{last}", f"run-{last}")
    }
    assert again == {*correct, f"register/run-{last}"}, sorted(ran)


def test_a_correction_paints_only_the_patches_again_that_show_its_frames(
    http: httpx.Client, forgetful: httpx.Client
) -> None:
    """The wall is painted once for frames 0 to 23, once to 47, and once to 71, with fades between them."""
    frames, at, solve, params = 72, 54, [52, 57], {"longest_patch": 24}
    image = np.ones(SIZE[::-1], np.uint16)
    cv2.circle(image, (10, 10), 6, 40, -1)
    films = []
    for client in (http, forgetful):
        value = document(upload(client, encoded((1,), frames), "one.mkv"), params=params)
        project = client.post("/v1/projects", json={"document": value}).json()["id"]
        if client is http:
            rendered(client, project)
        value["assets"]["map"] = {"id": upload(client, cv2.imencode(".png", image)[1].tobytes(), "map.png")}
        value["shots"][0]["layers"][0]["parts"] = {"labels": [{"frame": at, "image": "map", "solve": solve}]}
        client.put(f"/v1/projects/{project}", json=value, headers={"If-Match": '"1"'}).raise_for_status()
        job = rendered(client, project)
        films.append((tasks(client, job), film(client, job)))
    (found, again), (whole, anew) = films
    assert again == anew and found.keys() == whole.keys() and not any(whole.values())
    ran = {name for name, reused in found.items() if not reused}
    assert "patch/s0000000-l00040-f0000053" in ran, "the new patch"
    wall = {name for name in ran if name.startswith("patch/s0000000-l00001-")}
    last = {name for name in found if name.startswith("patch/s0000000-l00001-f0000048")}
    assert wall - last <= {f"patch/s0000000-l00001-f0000024-{part}" for part in ("placement", "sum-3")}, sorted(ran)
    painted = {name for name in ran if name.startswith("paint/")}
    assert painted and min(int(name[-7:]) for name in painted) >= 36 and len(painted) <= 5, sorted(painted)


def test_another_look_does_not_estimate_the_motion_again(clip: bytes, http: httpx.Client) -> None:
    flows = {"multistyle": "paint/flow-", "patches": "cluster/flow-"}
    changes = {"multistyle": {"style": "pointillism"}, "patches": {"style": "circles"}}
    for name, prefix in flows.items():
        value = document(upload(http, clip, "two.mkv"))
        value["output"] = {"format": "png"}
        layer = value["shots"][0]["layers"][0]
        layer["method"] = name
        project = http.post("/v1/projects", json={"document": value}).json()["id"]
        rendered(http, project)
        layer["params"] = changes[name]
        http.put(f"/v1/projects/{project}", json=value, headers={"If-Match": '"1"'}).raise_for_status()
        found = tasks(http, rendered(http, project))
        again = {task for task, reused in found.items() if not reused}
        assert {task for task in found if task.startswith(prefix)} and not any(t.startswith(prefix) for t in again)
        assert {task for task in found if task.startswith("paint/run")} <= again
        layer["params"] = {"flow": "tvl1"}
        http.put(f"/v1/projects/{project}", json=value, headers={"If-Match": '"2"'}).raise_for_status()
        found = tasks(http, rendered(http, project))
        assert not any(reused for task, reused in found.items() if task.startswith(prefix)), "other motion"


def test_results_outlive_the_job_that_made_them(clip: bytes, http: httpx.Client) -> None:
    """A job is deleted after a second one has reused its results; a third one reuses them from the second."""
    value = document(upload(http, clip, "two.mkv"))
    value["shots"][0] |= {"range": [0, 8]}
    project = http.post("/v1/projects", json={"document": value}).json()["id"]
    first, second = rendered(http, project), rendered(http, project)
    kept = film(http, first)
    assert http.delete(f"/v1/jobs/{first['id']}").status_code == 204
    third = rendered(http, project)
    for job in (second, third):
        ran = [name for name, reused in tasks(http, job).items() if not reused]
        assert ran == ["assemble/assemble"] and film(http, job) == kept
