"""The film of a layer at the size of a preview: which tasks run, and what a small cache does to it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.errors import Cancelled
from pipeline.methods import method
from pipeline.methods.abstraction import plan as abstraction_plan
from pipeline.methods.local import LocalContext, run_plan
from workers.blobs.disk import DiskBlobs
from workers.contract.record import asset_key
from workers.contract.request import JobRequest
from workers.farm import open_farm
from workers.previews.artefact_files import ArtefactFiles
from workers.previews.byte_cache import ByteCache
from workers.previews.film import Kept, PreviewFilm, _Run
from workers.previews.model import LayerSources, PreviewQuery
from workers.previews.streaming import streamed
from workers.previews.warm import WarmFrames
from workers.settings import FarmSettings

VIDEO = asset_key("ast_video")


@pytest.fixture
def blobs(home: Path, tiny_clip: Path) -> DiskBlobs:
    made = DiskBlobs(home)
    made.put(VIDEO, tiny_clip)
    return made


@pytest.fixture
def ran(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Tasks that run, in order: step/key."""
    names: list[str] = []
    run = _Run._run_task

    def noted(self: Any, name: tuple[str, str], alike: Any) -> None:
        names.append("/".join(name))
        run(self, name, alike)

    monkeypatch.setattr(_Run, "_run_task", noted)
    return names


def film(blobs: DiskBlobs, chosen: str, limit_bytes: int, disk_bytes: int = 1 << 30, **params: Any) -> PreviewFilm:
    cache = ByteCache(limit_bytes)
    layer = LayerSources("l1", chosen, params, 0, VIDEO)
    return PreviewFilm(layer, Kept(WarmFrames(blobs, cache), cache, ArtefactFiles(disk_bytes)), 640, dict)


def none() -> None:
    """A check that never raises."""


def test_only_the_tasks_that_a_frame_needs_run_and_none_runs_twice(
    blobs: DiskBlobs, ran: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(abstraction_plan, "RUN_FRAMES", 6)
    made = film(blobs, "abstraction", 1 << 26)
    list(made.frames([8], none))
    assert ran == ["scan/video", "abstract/run-0000000", "abstract/run-0000006"]
    list(made.frames([3, 9, 14], none))
    assert ran[3:] == ["abstract/run-0000012"]


@pytest.mark.parametrize("chosen", ["multistyle", "patches"])
def test_a_cache_that_is_too_small_changes_no_frame(blobs: DiskBlobs, chosen: str) -> None:
    context = LocalContext(method(chosen).Params(), list(_source(blobs)))
    run_plan(method(chosen), context)
    found = dict(film(blobs, chosen, 400_000).frames([20, 2, 13], none))
    assert all(np.array_equal(found[number], context.emitted[number]) for number in (2, 13, 20))


def test_lost_artefacts_are_made_again(blobs: DiskBlobs, ran: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(abstraction_plan, "RUN_FRAMES", 6)
    made = film(blobs, "abstraction", 1 << 26, disk_bytes=1)
    list(made.frames([8], none))
    list(made.frames([14], none))
    assert ran[3:] == ["abstract/run-0000012"], "the newest state is kept"
    ran.clear()
    list(made.frames([20], none))
    assert ran == ["abstract/run-0000018"]


def test_a_lost_artefact_is_made_again_for_a_task_that_does_not_name_its_maker(blobs: DiskBlobs) -> None:
    halves = {"left": {"polygons": [{"frame": 0, "points": [[0, 0], [0.5, 0], [0.5, 1], [0, 1]]}]}}
    design = {"version": 1, "regions": halves, "keys": [{"region": "left", "frame": 0, "set": {"hue": 0}}]}
    found = []
    for disk_bytes in (1 << 30, 1):
        cache = ByteCache(1 << 26)
        layer = LayerSources("l1", "multistyle", {}, 0, VIDEO, documents={"design": design})
        kept = Kept(WarmFrames(blobs, cache), cache, ArtefactFiles(disk_bytes))
        found.append(dict(PreviewFilm(layer, kept, 640, dict).frames([3], none))[3])
    assert np.array_equal(*found)


def test_regions_and_directions_are_those_of_the_film(blobs: DiskBlobs) -> None:
    halves = {"left": {"polygons": [{"frame": 3, "points": [[0, 0], [0.5, 0], [0.5, 1], [0, 1]]}]}}
    element = {"pattern": "center", "at": [0.3, 0.5], "reach": 0.4}
    direction = {"region": "left", "frame": 3, "edge_weight": 0.3, "elements": [element]}
    design = {"version": 1, "regions": halves, "directions": [direction]}
    chosen = method("multistyle")
    passes = frozenset({"orientation", "regions"})
    context = LocalContext(chosen.Params(), list(_source(blobs)), {"design": design})
    context.passes_wanted = passes
    run_plan(chosen, context)
    cache = ByteCache(1 << 26)
    layer = LayerSources("l1", "multistyle", {}, 0, VIDEO, documents={"design": design})
    made = PreviewFilm(layer, Kept(WarmFrames(blobs, cache), cache, ArtefactFiles(1 << 30)), 640, dict)
    for number in (2, 15, 23):
        regions, directions = (made.plane(kind, number, none) for kind in ("regions", "directions"))
        assert regions is not None and directions is not None
        assert regions.names == ("rest", "left")
        np.testing.assert_array_equal(regions.plane, context.made_passes[number]["regions"])
        unit = context.made_passes[number]["orientation"]
        angle = np.arctan2(unit[..., 1], unit[..., 0])
        apart = np.abs((angle - directions.plane[..., 0] + np.pi / 2) % np.pi - np.pi / 2)
        assert apart.max() < 0.01, "half precision"
    assert made.plane("regions", 99, none) is not None, "of the last frames"
    assert film(blobs, "multistyle", 1 << 26).plane("regions", 0, none) is None
    assert film(blobs, "patches", 1 << 26).plane("directions", 0, none) is None


def _source(blobs: DiskBlobs) -> Iterator[Any]:
    frames = WarmFrames(blobs, ByteCache(1 << 26))
    yield from frames.frames(VIDEO, 0, 24, 640)
    frames.close()


def test_a_client_that_leaves_ends_the_work() -> None:
    ended: list[str] = []

    def work(put: Any, check: Any) -> None:
        put(1)
        try:
            while True:
                check()
        except Cancelled:
            ended.append("cancelled")

    items = streamed(work, none)
    assert next(items) == 1
    items.close()  # type: ignore[attr-defined]
    assert ended == ["cancelled"]


def test_an_error_of_the_work_reaches_the_client() -> None:
    def work(put: Any, check: Any) -> None:
        put(1)
        raise ValueError("no")

    items = streamed(work, none)
    assert next(items) == 1
    with pytest.raises(ValueError, match="no"):
        next(items)


def test_the_first_preview_of_a_film_tells_what_the_film_costs(home: Path, tiny_clip: Path) -> None:
    farm = open_farm(FarmSettings(home=home, pool="local", workers=1))
    video = farm.assets.add(tiny_clip, "tiny.mp4").id
    request = JobRequest("abstraction", {"video": video}, {"lines": "off"})
    before = farm.jobs.estimate(request, "")
    layer = LayerSources("l1", "abstraction", {"lines": "off"}, 0, asset_key(video), below=asset_key(video))
    query = PreviewQuery("paint", "prj_1", "client", "stage", 1, (layer,), 64, {"frame": 3})
    records = list(farm.previews.start(query))
    assert {record.header["type"] for record in records} == {"begin", "frame", "end"}, "clients get no costs"
    after = farm.jobs.estimate(request, "")
    assert (before.samples, after.samples) == (0, 1) and after.cpu_s != before.cpu_s and after.seconds
    other = JobRequest("abstraction", {"video": video}, {"lines": "dog"})
    assert farm.jobs.estimate(other, "").samples == 0
    farm.stop()
