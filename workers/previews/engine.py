"""The engine: answers preview queries from cached state. Each process has its own engine."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Iterator

from workers.blobs.base import Blobs
from workers.execution.renderer import prepare_process
from workers.execution.warm_up import warm_up_process
from workers.previews.artefact_files import ArtefactFiles
from workers.previews.byte_cache import ByteCache
from workers.previews.context import PreviewContext
from workers.previews.kinds import (
    clusters,
    cuts,
    directions,
    flicker,
    matte,
    object_mask,
    paint,
    propagate,
    regions,
    suggest,
)
from workers.previews.memory import Check
from workers.previews.model import SINGLE, Overtaken, PreviewQuery, Record
from workers.previews.single import frame_png
from workers.previews.warm import WarmFrames

Kind = Callable[[PreviewContext], Iterator[Record]]


def kinds() -> dict[str, Kind]:
    """Every kind of preview by name."""
    return {
        "paint": paint.paint, "source": paint.source, "styles": paint.styles, "propagate": propagate.propagate,
        "regions": regions.regions, "directions": directions.directions, "keys": suggest.suggest,
        "flicker": flicker.flicker, "clusters": clusters.clusters, "spread": clusters.spread, "cuts": cuts.cuts,
        "object": object_mask.marked_object, "matte": matte.matte,
    }  # fmt: skip


class PreviewEngine:
    """Answers queries. Thread-safe.

    Args:
        limit_bytes: maximum size of cached frames and other state.
    """

    def __init__(self, blobs: Blobs, limit_bytes: int) -> None:
        prepare_process()
        self.cache = ByteCache(limit_bytes)
        self._blobs, self._frames, self._artefacts = blobs, WarmFrames(blobs, self.cache), ArtefactFiles()

    def warm_up(self) -> None:
        """Load the kernels of every method, compiling new ones. Never raises."""
        warm_up_process()

    def close(self) -> None:
        self._frames.close()
        self._artefacts.close()

    def run(self, query: PreviewQuery, check: Check) -> Generator[Record]:
        """Yield the records of the answer: "begin", those of the kind of preview, then "end" (or "overtaken").

        Raises: ImpastoError if the query is invalid; the answer then ends.
        """
        began = time.monotonic()
        context = PreviewContext(query, self._frames, self.cache, self._artefacts, check, began)
        yield Record({"type": "begin", "seq": query.seq})
        try:
            check()
            for record in self._frame(query, check) if query.what == SINGLE else kinds()[query.what](context):
                yield record
                check()
        except Overtaken as error:
            yield Record({"type": "overtaken", "by": error.by})
            return
        yield Record({"type": "end", "ms": context.ms})

    def _frame(self, query: PreviewQuery, check: Check) -> Iterator[Record]:
        """One frame of a job that is not submitted."""
        picture = frame_png(query.options["job"], self._frames, self._blobs, check)
        yield Record({"type": "frame", "media_type": "image/png"}, picture)
