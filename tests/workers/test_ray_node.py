"""A Ray node that does not start says why."""

from __future__ import annotations

import pytest

from pipeline.errors import StorageError
from tests.waiting import until
from workers.pools.ray_node import RayNode

pytestmark = pytest.mark.real("ray")


def test_an_address_that_is_none_is_said_in_one_line() -> None:
    def ended() -> bool:
        try:
            node.check()
        except StorageError as error:
            said.append(str(error))
        return bool(said)

    said: list[str] = []
    with RayNode("nope", "here", cpus=1) as node:
        until(ended, 60)
    assert "Invalid address format: nope" in said[0]
    assert "Traceback" not in said[0] and "\n" not in said[0]
