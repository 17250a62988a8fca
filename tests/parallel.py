"""How the suite is spread over processes (`make test`, pytest-xdist with `--dist loadfile`).

A file stays in one process, because its fixtures are often one server for all of its tests. Files that take longest
come first, so that no process works alone at the end.
"""

from __future__ import annotations

import pytest

LONGEST = (
    "tests/deploy/test_entrypoint.py",
    "tests/regression/test_recorded_values.py",
    "tests/e2e/test_studio_page.py",
    "tests/workers/test_ray_nodes.py",
    "tests/e2e/test_rolling_upgrade.py",
    "tests/e2e/test_same_bytes.py",
    "tests/workers/test_real_stores.py",
    "tests/e2e/test_page.py",
    "tests/e2e/test_kill.py",
    "tests/impasto/test_render.py",
    "tests/impasto/test_live_stream.py",
    "tests/deploy/test_images.py",
    "tests/service/test_live_endings.py",
    "tests/pipeline/video/test_repeatable_encoders.py",
    "tests/service/test_connections.py",
    "tests/pipeline/synthesis/test_parity.py",
    "tests/service/test_live.py",
    "tests/service/test_projects.py",
    "tests/e2e/test_ops_page.py",
)
"""Files of more than 20 s, longest first; the others follow in the order of their names."""


def arrange(items: list[pytest.Item]) -> None:
    """Order tests, in place: the slowest files first."""
    rank = {file: place for place, file in enumerate(LONGEST)}
    items.sort(key=lambda item: rank.get(item.nodeid.partition("::")[0], len(rank)))
