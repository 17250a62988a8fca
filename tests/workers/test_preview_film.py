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
from workers.previews.artefact_files import ArtefactFiles
from workers.previews.byte_cache import ByteCache
from workers.previews.film import Kept, PreviewFilm, _Run
from workers.previews.model import LayerSources
from workers.previews.streaming import streamed
from workers.previews.warm import WarmFrames

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
