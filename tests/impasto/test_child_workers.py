"""Child processes of a local farm: how many there are, and that they make the same files as threads."""

from __future__ import annotations

from pathlib import Path

import pytest

from pipeline.methods.base import PROCESS_BYTES
from tests.impasto.test_frame_window import rendered
from workers import farm as farms
from workers.farm import open_farm
from workers.model import JobRequest
from workers.pools.machine import Machine
from workers.settings import FarmSettings


@pytest.mark.parametrize("method", ["multistyle", "patches"])
def test_children_make_the_same_file_as_threads(method: str, tiny_clip: Path, tmp_path: Path) -> None:
    files = []
    for children in (0, 2):
        settings = FarmSettings(home=tmp_path / str(children), workers=2, child_workers=children, warm_up=False)
        farm = open_farm(settings, private=True)
        farm.start()
        video = farm.assets.add(tiny_clip, "tiny.mp4").id
        files.append(rendered(farm, JobRequest(method, {"video": video}, seed=3)))
        farm.stop()
    assert files[0] == files[1]


@pytest.mark.parametrize(
    ("processors", "gib", "workers", "children"),
    [(1, 8, 0, 0), (2, 8, 0, 0), (4, 16, 0, 2), (16, 64, 0, 14), (16, 4, 0, 1), (16, 64, 6, 4), (2, 8, 6, 0)],
)
def test_number_of_children(
    processors: int, gib: int, workers: int, children: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    memory = int(0.75 * (gib << 30)) - PROCESS_BYTES
    monkeypatch.setattr("workers.settings.usable_processors", lambda: processors)
    monkeypatch.setattr(farms, "this_machine", lambda: Machine(processors, memory))
    assert farms._children(FarmSettings(workers=workers)) == children


def test_a_set_number_of_children_is_at_most_that_of_workers() -> None:
    assert farms._children(FarmSettings(workers=3, child_workers=8)) == 3
    assert farms._children(FarmSettings(workers=3, child_workers=0)) == 0
