"""Work that may be done aside while a frame goes on: a frame is finished sooner, and not one bit is different."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Generic, ParamSpec, Protocol, TypeVar

P = ParamSpec("P")
T = TypeVar("T")
Covariant = TypeVar("Covariant", covariant=True)


class Later(Protocol[Covariant]):
    """A value that is there or will be."""

    def result(self) -> Covariant:
        """Wait for it; raises what its making raised."""
        ...


@dataclass(frozen=True)
class Now(Generic[T]):
    """A value that is there."""

    value: T

    def result(self) -> T:
        return self.value


class Aside:
    """Runs functions at once, or in turn on a helper's thread.

    What has a memory is given to it frame after frame: the helper must have ONE thread, so that frames keep their
    order. A function may wait for what was given before it, never for what comes after.
    """

    def __init__(self) -> None:
        self.helper: Executor | None = None

    def __call__(self, function: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> Later[T]:
        if self.helper is None:
            return Now(function(*args, **kwargs))
        return self.helper.submit(function, *args, **kwargs)

    def rows(self, work: Callable[[int, int], None], height: int) -> None:
        """`work(first, last)` over all rows of a picture; with a helper, it takes the upper half."""
        if self.helper is None:
            work(0, height)
            return
        upper = self.helper.submit(work, 0, height // 2)
        work(height // 2, height)
        upper.result()


ALONE = Aside()
"""Nobody helps."""
