"""Previews made in this process, on the threads of the callers."""

from __future__ import annotations

from collections.abc import Iterator

from workers.blobs.base import Blobs
from workers.contract.request import Json
from workers.previews.engine import PreviewEngine
from workers.previews.memory import Check
from workers.previews.model import PreviewQuery, Record


class LocalRunner:
    """A `PreviewRunner` over an engine of this process."""

    def __init__(self, blobs: Blobs, limit_bytes: int) -> None:
        self._engine = PreviewEngine(blobs, limit_bytes)

    def start(self) -> None:
        return

    def run(self, query: PreviewQuery, check: Check) -> Iterator[Record]:
        return self._engine.run(query, check)

    def state(self) -> Json:
        cache = self._engine.cache
        return {"bytes": cache.size_bytes, "limit_bytes": cache.limit_bytes, "restarts": 0, "where": "process"}

    def close(self) -> None:
        self._engine.close()
