"""Previews in Ray actors: equal to those of this process, kept through kills, cancelled when overtaken, ended when
idle."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from pipeline.errors import BadParameter
from tests.waiting import until
from tests.workers.watched_engine import Watched
from workers.blobs.disk import DiskBlobs
from workers.contract.record import Asset, asset_key
from workers.contract.request import JobRequest
from workers.farm import open_farm
from workers.previews.byte_cache import ByteCache
from workers.previews.local_runner import LocalRunner
from workers.previews.model import LayerSources, PreviewQuery, Record
from workers.previews.service import PreviewService
from workers.previews.single import PreviewAsk, PreviewJob, frame_png
from workers.previews.warm import WarmFrames
from workers.settings import FarmSettings

pytestmark = pytest.mark.real("ray")

LIMIT_BYTES = 64 << 20
VIDEO = "video.mp4"
LAYER = LayerSources("l1", "abstraction", {}, 0, VIDEO)
FILM = PreviewQuery("paint", "p", "tab", "film", 1, (LAYER,), 64, {"frames": (0, 6), "step": 1})
Made = Callable[..., Any]


def never() -> None:
    """A client that never disconnects."""


@pytest.fixture(scope="module")
def blobs(tmp_path_factory: pytest.TempPathFactory, tiny_clip: Path) -> Iterator[DiskBlobs]:
    import ray

    from workers.pools.ray_cluster import connect

    home = tmp_path_factory.mktemp("ray")
    connect(FarmSettings(home=home, pool="ray", workers=1))
    stored = DiskBlobs(home)
    stored.put(VIDEO, tiny_clip.read_bytes())
    yield stored
    ray.shutdown()


@pytest.fixture(scope="module")
def notes_at(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("notes")


@pytest.fixture
def notes(notes_at: Path) -> Path:
    """The empty folder to which engines write their notes."""
    for file in notes_at.iterdir():
        file.unlink()
    return notes_at


def _started(blobs: DiskBlobs, notes: Path, most: int, idle_s: float = 600.0) -> Any:
    """A runner whose engines leave notes."""
    from workers.previews.ray_runner import PreviewActors, RayRunner

    actors = PreviewActors(most, LIMIT_BYTES, 2, idle_s, warms_up=False)
    runner = RayRunner(blobs, actors, partial(Watched, blobs, notes))
    runner.start()
    return runner


@pytest.fixture
def made(blobs: DiskBlobs, notes: Path) -> Iterator[Made]:
    """Makes runners, which end with the test."""
    runners = []

    def make(most: int, idle_s: float = 600.0) -> Any:
        runners.append(_started(blobs, notes, most, idle_s))
        return runners[-1]

    yield make
    for runner in runners:
        runner.close()


@pytest.fixture(scope="module")
def runner(blobs: DiskBlobs, notes_at: Path) -> Iterator[Any]:
    """A runner with one actor, for all tests that do without an actor of their own: each costs 1.5 CPU s."""
    shared = _started(blobs, notes_at, 1)
    yield shared
    shared.close()


def _comparable(records: list[Record]) -> list[tuple[dict[str, object], bytes]]:
    """Records without times: how long tasks took is told, too."""
    told = [record for record in records if record.header["type"] != "cost"]
    return [({k: v for k, v in record.header.items() if k != "ms"}, record.payload) for record in told]


def _process(runner: Any) -> int:
    return int(runner.state()["processes"][0])


def test_a_preview_is_the_same_in_an_actor_and_after_kill_9_in_its_middle(
    runner: Any, blobs: DiskBlobs, notes: Path
) -> None:
    local = LocalRunner(blobs, LIMIT_BYTES)
    wanted = _comparable(list(local.run(FILM, never)))
    local.close()
    restarts = runner.state()["restarts"]
    assert _comparable(list(runner.run(FILM, never))) == wanted
    assert runner.state()["bytes"] > 0

    answer = runner.run(replace(FILM, options=FILM.options | {"waits_at": 3}), never)
    found = [next(answer) for _ in range(3)]
    after = threading.Thread(target=lambda: found.extend(answer))
    after.start()
    until(lambda: (notes / "waits").exists(), 30)
    victim = _process(runner)
    os.kill(victim, signal.SIGKILL)
    (notes / "go").touch()
    after.join(120)
    assert _comparable(found) == wanted
    assert runner.state()["restarts"] == restarts + 1
    assert _process(runner) != victim

    os.kill(_process(runner), signal.SIGKILL)
    assert _comparable(list(runner.run(FILM, never))) == wanted, "the next preview answers, too"


def test_an_overtaken_preview_ends_in_the_actor(runner: Any, notes: Path) -> None:
    service = PreviewService(runner, 2)
    slow = replace(FILM, options=FILM.options | {"waits_at": 1})
    answer = iter(service.start(slow))
    first: list[Record] = [next(answer)]
    rest = threading.Thread(target=lambda: first.extend(answer))
    rest.start()
    until(lambda: (notes / "waits").exists(), 30)
    later = service.start(replace(FILM, seq=2))
    rest.join(60)
    assert [record.header["type"] for record in first] == ["begin", "overtaken"]
    until(lambda: (notes / "cancelled").exists(), 30)
    assert [record.header["type"] for record in later] == ["begin", *["frame"] * 6, "end"]


def test_a_preview_that_nobody_reads_any_more_ends_in_the_actor(runner: Any, notes: Path) -> None:
    answer = runner.run(replace(FILM, options=FILM.options | {"waits_at": 2}), never)
    next(answer), next(answer)
    answer.close()
    assert list(runner.run(replace(FILM, project="q"), never))[-1].header["type"] == "end"
    assert not (notes / "waits").exists(), "a record is made when it is asked for"


def test_errors_keep_their_class_and_a_deadly_query_fails(runner: Any) -> None:
    from workers.previews.ray_runner import PreviewLost

    restarts = runner.state()["restarts"]
    with pytest.raises(BadParameter) as raised:
        list(runner.run(replace(FILM, layers=(replace(LAYER, params={"seed_of_all": 1}),)), never))
    assert "seed_of_all" in str(raised.value)
    assert runner.state()["restarts"] == restarts
    with pytest.raises(PreviewLost):
        list(runner.run(replace(FILM, options=FILM.options | {"deadly": True}), never))
    assert list(runner.run(FILM, never))[-1].header["type"] == "end"


def test_projects_have_actors_of_their_own_while_there_are_enough(made: Made, notes: Path) -> None:
    runner = made(2)
    for project in ("p", "q", "r", "p"):
        assert list(runner.run(replace(FILM, project=project), never))[-1].header["type"] == "end"
    pids = [(notes / project).read_text() for project in ("p", "q", "r")]
    assert pids[0] != pids[1]
    assert set(pids) == {str(pid) for pid in runner.state()["processes"]}


def test_an_idle_actor_ends_and_the_next_preview_answers(made: Made, notes: Path) -> None:
    runner = made(1, idle_s=1.0)
    wanted = _comparable(list(runner.run(FILM, never)))
    pid = (notes / "p").read_text()
    until(lambda: not Path(f"/proc/{pid}").exists(), 30)
    assert _comparable(list(runner.run(FILM, never))) == wanted
    assert (notes / "p").read_text() != pid
    assert runner.state()["restarts"] == 0


def test_a_frame_of_a_job_is_the_same_in_an_actor(runner: Any, blobs: DiskBlobs, notes: Path) -> None:
    blobs.put(asset_key("clip"), blobs.get(VIDEO))
    request = JobRequest("abstraction", {"video": "clip"})
    assets = {"video": Asset("clip", "0" * 64, 1, "clip.mp4", "video/mp4", "video", {}, 0.0)}
    job, frames = PreviewJob(request, assets, PreviewAsk(3, 64)), WarmFrames(blobs, ByteCache(1 << 24))
    wanted = frame_png(job, frames, blobs, never)
    frames.close()
    previews = PreviewService(runner, slots=1)
    assert [previews.frame(job) for _ in range(2)] == [wanted, wanted]
    assert (notes / "clip").read_text() != str(os.getpid())


def test_a_farm_on_ray_makes_its_previews_there(tmp_path: Path) -> None:
    for pool, where in (("ray", "ray"), ("none", "process")):
        farm = open_farm(FarmSettings(home=tmp_path / pool, pool=pool))
        assert farm.previews.state()["where"] == where
        farm.stop()
