"""A Ray cluster of several raylets on this machine, some of which are killed."""

from __future__ import annotations

import itertools
import random
import signal
import time
from typing import Any

import psutil

_ACTOR = "ray::_RenderActor"
_PATIENCE_S = 20.0


class Raylets:
    """A head that runs nothing, and nodes of two processors."""

    def __init__(self, nodes: int = 2) -> None:
        from ray.cluster_utils import Cluster

        handler = signal.getsignal(signal.SIGTERM)  # Ray's test cluster takes it
        self._names = (f"node-{number}" for number in itertools.count(1))
        self._cluster: Any = Cluster(initialize_head=True, head_node_args={"num_cpus": 0, "node_name": "head"})
        self._nodes = [self._add() for _ in range(nodes)]
        self._cluster.wait_for_nodes()
        signal.signal(signal.SIGTERM, handler)

    @property
    def address(self) -> str:
        return str(self._cluster.address)

    def _add(self) -> Any:
        return self._cluster.add_node(num_cpus=2, node_name=next(self._names), object_store_memory=80 << 20)

    def kill_node(self, chance: random.Random) -> None:
        gone = chance.choice(self._nodes)
        self._cluster.remove_node(gone, allow_graceful=False)
        self._nodes[self._nodes.index(gone)] = self._add()

    def kill_actor(self, chance: random.Random) -> None:
        """Kill a random actor; if there is none, wait for one to start."""
        deadline = time.monotonic() + _PATIENCE_S
        while not (found := _actors()) and time.monotonic() < deadline:
            time.sleep(0.1)
        if found:
            chance.choice(found).kill()

    def close(self) -> None:
        self._cluster.shutdown()


def _actors() -> list[psutil.Process]:
    """The actors of this process's cluster: descendants that run tasks."""
    ours = psutil.Process().children(recursive=True)
    return sorted((one for one in ours if _is_actor(one)), key=lambda one: one.pid)


def _is_actor(process: psutil.Process) -> bool:
    try:
        return process.is_running() and "".join(process.cmdline()).startswith(_ACTOR)
    except psutil.Error:
        return False
