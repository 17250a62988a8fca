"""How the suite is spread over processes (`make test`: pytest-xdist).

A file stays in one process, because its fixtures are often one server for all of its tests. Files that share a service
and a browser, or a Ray cluster, stay in one process together: to start these costs more than most of their tests. What
takes longest comes first, so that no process works alone at the end.
"""

from __future__ import annotations

import re
import subprocess
from contextlib import suppress
from pathlib import Path
from typing import Any

import psutil
import pytest
from xdist.scheduler import LoadFileScheduling

IN_CHROMIUM = (
    (
        "tests/e2e/test_studio_page.py",
        "tests/e2e/test_studio_clusters.py",
        "tests/e2e/test_studio_films.py",
        "tests/e2e/test_studio_film_shots.py",
        "tests/e2e/test_studio_looks.py",
        "tests/e2e/test_studio_room.py",
        "tests/e2e/test_studio_whole_film.py",
        "tests/e2e/test_studio_play_film.py",
        "tests/e2e/test_studio_comments.py",
        "tests/e2e/test_studio_access.py",
        "tests/e2e/test_studio_saving.py",
        "tests/e2e/test_studio_layers.py",
        "tests/e2e/test_studio_mattes.py",
        "tests/e2e/test_studio_colours.py",
        "tests/e2e/test_studio_corrections.py",
        "tests/e2e/test_studio_variants.py",
        "tests/e2e/test_studio_lesson.py",
        "tests/e2e/test_studio_waiting.py",
        "tests/e2e/test_studio_psd.py",
    ),
    (
        "tests/e2e/test_page.py",
        "tests/e2e/test_ops_page.py",
        "tests/e2e/test_account_page.py",
        "tests/e2e/test_studio_losses.py",
        "tests/e2e/test_studio_design.py",
        "tests/e2e/test_studio_region_styles.py",
        "tests/e2e/test_studio_paper_figures.py",
        "tests/e2e/test_studio_neighbours.py",
        "tests/e2e/test_studio_sharing.py",
        "tests/e2e/test_works_page.py",
        "tests/e2e/test_studio_film_here.py",
        "tests/e2e/test_studio_painting.py",
        "tests/e2e/test_studio_brushes.py",
        "tests/e2e/test_studio_paint_layers.py",
        "tests/e2e/test_studio_shots.py",
        "tests/e2e/test_studio_truth.py",
        "tests/e2e/test_studio_pointers.py",
        "tests/e2e/test_live_page.py",
    ),
)
"""Two groups of files of about equal duration; the files of a group share the service and the browser of
tests/e2e/conftest.py."""
ON_RAY = (
    "tests/workers/test_ray_nodes.py",
    "tests/workers/test_preview_ray.py",
    "tests/workers/test_ray_pool.py",
    "tests/workers/test_live_ray.py",
)
"""Files that start clusters, one after the other."""
LONGEST = (
    *IN_CHROMIUM[0],
    *IN_CHROMIUM[1],
    *ON_RAY,
    "tests/laws/test_laws.py",
    "tests/service/test_preview_is_film.py",
    "tests/workers/test_real_stores.py",
    "tests/e2e/test_kill.py",
    "tests/service/test_reuse.py",
    "tests/deploy/test_entrypoint.py",
    "tests/laws/test_seven_ways.py",
    "tests/e2e/test_rolling_upgrade.py",
    "tests/e2e/test_same_bytes.py",
    "tests/pipeline/methods/test_analogy.py",
    "tests/impasto/test_render.py",
    "tests/regression/test_recorded_values.py",
    "tests/pipeline/methods/test_analogy_faults.py",
    "tests/workers/test_hanging.py",
    "tests/contracts/test_random_work.py",
    "tests/deploy/test_images.py",
    "tests/pipeline/synthesis/test_bounds.py",
    "tests/pipeline/methods/test_patches.py",
    "tests/impasto/test_service.py",
    "tests/service/test_schema_fuzz.py",
    "tests/pipeline/synthesis/test_parity.py",
    "tests/e2e/test_wheel.py",
    "tests/service/test_generated_typescript_client.py",
    "tests/contracts/test_dispatch.py",
    "tests/impasto/test_live_stream.py",
    "tests/service/test_live_endings.py",
    "tests/service/test_live.py",
    "tests/outside/test_fifth_method.py",
)
"""Files of more than 12 CPU s or 20 s, longest first; the others follow in the order of their names."""


def arrange(items: list[pytest.Item]) -> None:
    """Order tests, in place: the slowest files first."""
    rank = {file: place for place, file in enumerate(LONGEST)}
    items.sort(key=lambda item: rank.get(item.nodeid.partition("::")[0], len(rank)))


class Scheduling(LoadFileScheduling):
    """A file is one unit of work, and so is each group of files."""

    def _split_scope(self, nodeid: str) -> str:
        file = super()._split_scope(nodeid)
        return next((group[0] for group in (*IN_CHROMIUM, ON_RAY) if file in group), file)

    def _reschedule(self, node: Any) -> None:
        """Give no work to a process that still collects: two that replace ended ones start at different speeds."""
        if node in self.registered_collections:
            super()._reschedule(node)

    def remove_node(self, node: Any) -> str | None:
        """Give the work of a process that has ended to others, without the test in which it ended: it would end each of
        them. Returns that test."""
        for tests in self.assigned_work[node].values():
            for name, done in tests.items():
                if not done:
                    tests[name] = True
                    super().remove_node(node)
                    return name
        return super().remove_node(node)


def how_it_ended(process: subprocess.Popen[bytes]) -> str:
    """How a test process ended, and whether memory was short."""
    with suppress(subprocess.TimeoutExpired):
        process.wait(10)
    counters = Path("/proc/vmstat")  # of Linux
    killed = re.search(r"oom_kill (\d+)", counters.read_text()) if counters.exists() else None
    return (
        f"exit status {process.returncode} (negative: a signal; None: it still runs); "
        f"{psutil.virtual_memory().available >> 20} MiB of memory are available; "
        f"since its start the system has killed {killed[1] if killed else '?'} processes for want of memory"
    )
