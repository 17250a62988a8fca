"""Live sessions: a causal method applied to a stream of frames, and filters of the painted frames."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import Executor
from typing import Any, Protocol, TypeAlias

from pipeline.frames import Frame

References: TypeAlias = Mapping[str, Any]
"""Inputs of a session besides the stream, by name: an iterator of the frames of a picture or a video, or the parsed
document of an input of kind "json"."""


class Session(Protocol):
    """A causal method applied to a stream: one frame in, one frame out.

    `step(frame)` is `paint(analyze(frame))`. The two stages keep separate state: `analyze` of a frame may run on one
    thread while `paint` of an earlier frame runs on another, as long as each half receives every frame, in order.
    """

    def step(self, frame: Frame) -> Frame: ...

    def analyze(self, frame: Frame) -> object:
        """First half: the analysis of the incoming frame, an opaque value for `paint`."""
        ...

    def paint(self, analysis: Any) -> Frame:
        """Second half: the outgoing frame."""
        ...

    def use_helper(self, helper: Executor) -> None:
        """Run independent parts of a frame on `helper`, too, from now on. This shortens the latency of a frame and
        raises the total CPU time; the output bytes stay the same.

        Args:
            helper: an executor with one thread. It must outlive the session.
        """
        ...

    def reconfigure(
        self, params: Any, size: tuple[int, int], references: References | None = None,
        output_size: tuple[int, int] | None = None,
    ) -> Session:  # fmt: skip
        """A session that continues this one with other parameters or another frame size, without a visible jump.

        Args:
            params: the method's Params.
            size: (width, height) of the following frames, px.
            references: as for `Method.stream`; None keeps those in use.
            output_size: (width, height) of the outgoing frames, px, where the method can draw them larger than `size`;
                other methods ignore it, and their outgoing frames have `size`, as with None.

        Call it when every analyzed frame has been painted; do not use this session afterwards.
        """
        ...


class LiveFilter(Protocol):
    """A causal filter of the frames that any session paints, which also uses the frames they were painted from.

    `analyze` and `apply` keep separate state, like the stages of a `Session`, and may run on two threads.
    """

    def analyze(self, source: Frame) -> object:
        """First half: the analysis of the incoming frame, an opaque value for `apply`."""
        ...

    def apply(self, analysis: Any, painted: Frame) -> Frame:
        """Second half: the filtered frame.

        Args:
            painted: the session's painting of that incoming frame, with the same size.
        """
        ...

    def reconfigure(self, params: Any, size: tuple[int, int]) -> LiveFilter:
        """A filter that continues this one with other parameters or another frame size (width, height), px.

        Call it when every analyzed frame has been filtered; do not use this filter afterwards.
        """
        ...
