"""What the stage shows at a frame is what the film has there: previews over HTTP against films that the farm painted.

The clip has two shots of 22 frames with a disc that moves before a wall. Previews at full size are compared with the
film of the same document, smaller ones with the film of the clip and its drawings at that size.
"""

from __future__ import annotations

import io
import json
import random
import time
import zipfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import av
import cv2
import httpx
import numpy as np
import pytest
from numpy.typing import NDArray

from service.settings import Settings
from tests.service.live import running
from tests.service.records import picture, records
from workers.farm import open_farm

SIZE, SMALL = (120, 80), (60, 40)
SHOT_FRAMES = 22
FRAMES = 2 * SHOT_FRAMES
Json = dict[str, Any]
Picture = NDArray[np.uint8]


@pytest.fixture(scope="module")
def http(tmp_path_factory: pytest.TempPathFactory) -> Iterator[httpx.Client]:
    settings = Settings(home=tmp_path_factory.mktemp("home"), pool="local", workers=1)
    farm = open_farm(settings)
    farm.start()
    with running(settings, farm) as url, httpx.Client(base_url=url, timeout=240) as client:
        yield client
    farm.stop()


def source_frames() -> list[Picture]:
    """Frames of the clip, RGB."""
    frames = []
    for shot in (1, 2):
        wall = np.random.default_rng(shot).integers(60, 190, (20, 30 + SHOT_FRAMES, 3), np.uint8)
        wall = cv2.resize(wall, (4 * wall.shape[1], SIZE[1]), interpolation=cv2.INTER_CUBIC)
        for index in range(SHOT_FRAMES):
            frame = np.ascontiguousarray(wall[:, index : index + SIZE[0]])
            cv2.circle(frame, (30 + 2 * index, 40), 16, (230, 120, 40) if shot == 1 else (30, 200, 60), -1)
            cv2.circle(frame, (27 + 2 * index, 36), 5, (20, 20, 20), -1)
            frames.append(frame)
    return frames


def lossless(frames: list[Picture]) -> bytes:
    out = io.BytesIO()
    with av.open(out, "w", format="matroska") as container:
        stream = container.add_stream("ffv1", rate=24)
        stream.height, stream.width = frames[0].shape[:2]
        stream.pix_fmt = "bgr0"
        for frame in frames:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(frame, format="rgb24")))
        container.mux(stream.encode(None))
    return out.getvalue()


def scaled(image: Picture, size: tuple[int, int]) -> Picture:
    """As previews scale pictures and drawings."""
    if (image.shape[1], image.shape[0]) == size:
        return image
    interpolation = cv2.INTER_NEAREST if image.ndim == 2 else cv2.INTER_AREA
    return np.asarray(cv2.resize(image, size, interpolation=interpolation), np.uint8)


def png(image: Picture) -> bytes:
    shown = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
    return cv2.imencode(".png", shown)[1].tobytes()


def painted_key(number: int) -> Picture:
    """Frame `number` with a painting over it."""
    frame = source_frames()[number]
    frame = np.asarray(frame // 2 + np.array([120, 20, 60]), np.uint8)
    return np.asarray(cv2.line(frame, (10, 10 + number), (110, 70 - number), (250, 240, 20), 4), np.uint8)


def style() -> Picture:
    rng = np.random.default_rng(5)
    return cv2.resize(rng.integers(0, 255, (12, 12, 3), np.uint8), (96, 96), interpolation=cv2.INTER_NEAREST)


def scribble() -> Picture:
    marks = np.full((SIZE[1], SIZE[0]), 128, np.uint8)
    marks[:, 80:] = 0
    return cv2.circle(marks, (34, 40), 8, 255, -1)


def left_half() -> Picture:
    labels = np.zeros((SIZE[1], SIZE[0]), np.uint8)
    labels[:, : SIZE[0] // 2] = 1
    return labels


@dataclass(frozen=True)
class Case:
    """Layers of a document and the pictures that they name.

    Attributes:
        most: mean difference of a frame that is allowed, levels of 255; the same bytes if it is 0.
        scales: whether a smaller preview is compared, too.
    """

    layers: tuple[Json, ...]
    drawings: Mapping[str, Picture] = field(default_factory=dict)
    most: float = 0.0
    scales: bool = True


FAST = {"levels": 2, "iterations": 2}
DESIGN = {
    "regions": {"box": {"polygons": [{"frame": 3, "points": [[0.1, 0.2], [0.5, 0.2], [0.5, 0.8], [0.1, 0.8]]}]}},
    "style_keys": [
        {"region": "box", "frame": 2, "style": "pointillism"},
        {"region": "box", "frame": 18, "set": {"hue": 120, "size": 20}, "ease": "smooth"},
        {"region": "rest", "frame": 0},
    ],
    "directions": [
        {"region": "rest", "frame": 4, "elements": [{"pattern": "center", "at": [0.7, 0.4], "reach": 0.4}]},
        {"region": "box", "frame": 4, "elements": [{"pattern": "regular", "at": [0.3, 0.5], "angle": 30}]},
    ],
}
CASES = {
    "abstraction": Case(({"method": "abstraction"},)),
    "multistyle": Case(({"method": "multistyle"},), scales=False),
    "multistyle design": Case(({"method": "multistyle", **DESIGN},)),
    "multistyle label maps": Case(
        (
            {
                "method": "multistyle",
                "regions": {"left": {"label": 1}},
                "style_keys": [{"region": "left", "frame": 0, "style": "pointillism"}, {"region": "rest", "frame": 0}],
                "region_maps": [{"frame": 5, "image": "left"}],
            },
        ),
        {"left": left_half()},
    ),
    "patches": Case(({"method": "patches", "scribbles": [{"frame": 1, "image": "marks"}]},), {"marks": scribble()}),
    "analogy style": Case(
        ({"method": "analogy", "params": FAST, "inputs": {"style_output": "style"}},), {"style": style()}, scales=False
    ),
    "analogy one key": Case(
        ({"method": "analogy", "params": FAST, "keys": [{"frame": 2, "image": "key"}]},),
        {"key": painted_key(2)},
        scales=False,
    ),
    "analogy two keys": Case(
        (
            {
                "method": "analogy",
                "params": FAST,
                "keys": [{"frame": 1, "image": "first"}, {"frame": 19, "image": "second"}],
            },
        ),
        {"first": painted_key(1), "second": painted_key(19)},
    ),
    "steady": Case(({"method": "steady", "inputs": {"styled": "styled"}},)),
    "layers": Case(
        (
            {"method": "abstraction", "id": "below"},
            {"method": "multistyle", "opacity": 0.6, "blend": "multiply", "matte": "matte"},
        ),
        {"matte": left_half() * 255},
    ),
}  # fmt: skip


def project(http: httpx.Client, case: Case, size: tuple[int, int]) -> str:
    """A project of the case whose video and drawings have this size; its address."""
    frames = [scaled(frame, size) for frame in source_frames()]
    factor = size[0] / SIZE[0]
    files = {"clip": ("clip.mkv", lossless(frames))}
    files["styled"] = ("styled.mkv", lossless([255 - frame for frame in frames]))
    for name, drawing in case.drawings.items():
        own = round(drawing.shape[1] * factor), round(drawing.shape[0] * factor)
        files[name] = (f"{name}.png", png(scaled(drawing, own)))
    assets = {name: {"id": http.post("/v1/assets", files={"file": file}).json()["id"]} for name, file in files.items()}
    layers = [{"id": f"l{number}", **layer} for number, layer in enumerate(case.layers)]
    document = {"schema": 1, "name": "Disc", "assets": assets, "output": {"format": "png"},
                "shots": [{"id": "s1", "video": "clip", "layers": layers}]}  # fmt: skip
    made = http.post("/v1/projects", json={"document": document})
    assert made.status_code == 201, made.text
    return str(made.json()["links"]["self"])


def film(http: httpx.Client, at: str) -> list[Picture]:
    answer = http.post(f"{at}/jobs", json={})
    assert answer.status_code == 201, answer.text
    job = answer.json()["items"][0]["job"]
    until = time.monotonic() + 300
    while (state := http.get(f"/v1/jobs/{job['id']}").json())["state"] not in ("succeeded", "failed"):
        assert time.monotonic() < until
        time.sleep(0.1)
    assert state["state"] == "succeeded", state["error"]
    data = http.get(f"/v1/jobs/{job['id']}/result").content
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        return [picture(archive.read(name)) for name in sorted(archive.namelist()) if name.endswith(".png")]


def stage(http: httpx.Client, at: str, frame: int, side_px: int) -> Picture:
    """What the stage shows at last."""
    found = records(
        http.post(f"{at}/previews/paint", json={"shot": "s1", "frame": frame, "max_side_px": side_px}).content
    )
    assert found[-1][0]["type"] == "end", found[-1][0]
    shown = [(header, data) for header, data in found if header["type"] == "frame"]
    assert shown[-1][0]["final"]
    return picture(shown[-1][1])


def differences(http: httpx.Client, case: Case, size: tuple[int, int], count: int = 20) -> dict[int, float]:
    """Mean difference in levels of `count` random frames of the stage, at `size`, and the film of that size."""
    at = project(http, case, SIZE)
    painted = film(http, at if size == SIZE else project(http, case, size))
    assert len(painted) == FRAMES
    numbers = random.Random(7).sample(range(FRAMES), count)
    return {n: float(np.abs(stage(http, at, n, size[0]).astype(int) - painted[n]).mean()) for n in numbers}


@pytest.mark.timeout(600)
@pytest.mark.parametrize("name", CASES)
def test_the_stage_shows_the_frames_of_the_film(http: httpx.Client, name: str) -> None:
    found = differences(http, CASES[name], SIZE)
    assert max(found.values()) <= CASES[name].most, json.dumps(found)


@pytest.mark.timeout(600)
@pytest.mark.parametrize("name", [name for name, case in CASES.items() if case.scales])
def test_a_smaller_stage_shows_the_frames_of_the_smaller_film(http: httpx.Client, name: str) -> None:
    found = differences(http, CASES[name], SMALL, 6)
    assert max(found.values()) <= max(2.0, CASES[name].most), json.dumps(found)


def test_a_picked_object_has_its_style_in_a_smaller_stage(http: httpx.Client) -> None:
    at = project(http, Case(({"method": "multistyle"},)), SIZE)
    tubes = records(http.post(f"{at}/previews/regions", json={"shot": "s1", "frame": 12}).content)
    maps = {header["type"]: (header, data) for header, data in tubes}
    coded = picture(maps["map"][1]).astype(np.int64)
    numbers = coded[..., 2] << 16 | coded[..., 1] << 8 | coded[..., 0]
    owner = maps["regions"][0]["tubes"][str(numbers[48, 54])]["object"]
    inside = np.isin(numbers, maps["regions"][0]["objects"][str(owner)]["tubes"]).astype(np.uint8)
    disc = cv2.resize(inside, SMALL, interpolation=cv2.INTER_NEAREST)
    plain = stage(http, at, 12, SMALL[0]).astype(int)
    keys = [{"region": "disc", "frame": 0, "set": {"hue": 180}}, {"region": "rest", "frame": 0}]
    designed = Case(({"method": "multistyle", "regions": {"disc": {"objects": [owner]}}, "style_keys": keys},))
    change = np.abs(stage(http, project(http, designed, SIZE), 12, SMALL[0]) - plain).mean(axis=2)
    far = cv2.dilate(disc, np.ones((9, 9), np.uint8)) == 0
    assert disc.sum() > 60 and far.sum() > 60
    assert change[disc > 0].mean() > 20 and change[far].mean() < 4
