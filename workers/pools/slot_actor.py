"""A worker of the Ray pool: an actor, what it has reserved, and what it runs."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

from workers.pools.capacity import Capacity
from workers.pools.ray_types import Actor, ObjectRef


@dataclass
class SlotActor:
    """An actor and its current attempt."""

    actor: Actor
    hello: ObjectRef
    """Reference to the answer of `hello`; None once it has arrived."""
    capacity: Capacity
    """Resources that Ray has reserved for the actor."""
    avoids: frozenset[str] = frozenset()
    """Ids of Ray nodes on which it must not start."""
    name: str = ""
    node: str = ""
    attempt_id: str = ""
    made_at: float = field(default_factory=time.monotonic)
    """Time of its request, monotonic s."""
    waiting_since: float = field(default_factory=time.monotonic)
    """Time since which it has waited for a machine and no idle actor was ended for it."""
    too_large_since: float | None = None
    """Time since which no machine of the cluster is large enough for it, even if idle; monotonic s."""
    signs: int = -1
    """Sign of life that its actor has last answered with."""
    answer: ObjectRef = None
    """Reference to the outcome of the attempt."""

    @property
    def idle(self) -> bool:
        return bool(self.name) and not self.attempt_id
