"""Processes of a local farm: how many there are, and that they make the same files as the threads of one command."""

from __future__ import annotations

from pathlib import Path

import pytest

from pipeline.methods.base import PROCESS_BYTES
from tests.impasto.test_frame_window import rendered
from workers.contract.request import JobRequest
from workers.farm import open_farm
from workers.pools.machine import max_processes
from workers.settings import FarmSettings


@pytest.mark.parametrize("method", ["multistyle", "patches"])
def test_processes_make_the_same_file_as_threads(method: str, tiny_clip: Path, tmp_path: Path) -> None:
    files = []
    for private in (False, True):
        settings = FarmSettings(home=tmp_path / str(private), workers=2, warm_up=False)
        farm = open_farm(settings, private=private)
        farm.start()
        video = farm.assets.add(tiny_clip, "tiny.mp4").id
        files.append(rendered(farm, JobRequest(method, {"video": video}, seed=3)))
        farm.stop()
    assert files[0] == files[1]


@pytest.mark.parametrize(
    ("processors", "gib", "threads", "most"),
    [
        (1, 8, 0, 1),
        (2, 8, 0, 2),
        (4, 16, 0, 4),
        (16, 64, 0, 16),
        (16, 4, 0, 2),
        (16, 4, 2, 4),
        (2, 1, 0, 1),
        (2, 1, 2, 2),
    ],
)
def test_number_of_attempts_at_once(processors: int, gib: int, threads: int, most: int) -> None:
    memory = max(0, int(0.75 * (gib << 30)) - PROCESS_BYTES)
    assert max_processes(processors, memory, threads) == most
