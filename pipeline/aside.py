"""Work that may be done aside while a frame goes on: a frame is finished sooner, and not one bit is different."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor, Future
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


@dataclass(frozen=True)
class Offered(Generic[T]):
    """A value that another thread may have made by the time it is asked for; else it is made then."""

    taken: Future[T]
    make: Callable[[], T]

    def result(self) -> T:
        return self.make() if self.taken.cancel() else self.taken.result()


class Aside:
    """Runs functions at once, or in turn on a helper's thread.

    What has a memory is given to it frame after frame: the helper must have ONE thread, so that frames keep their
    order. A function may wait for what was given before it, never for what comes after.
    """

    def __init__(self, helper: Executor | None = None) -> None:
        self.helper = helper

    def __call__(self, function: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> Later[T]:
        if self.helper is None:
            return Now(function(*args, **kwargs))
        return self.helper.submit(function, *args, **kwargs)

    def offer(self, make: Callable[[], T]) -> Later[T]:
        """What remembers nothing: the helper makes it if it is free in time."""
        return Now(make()) if self.helper is None else Offered(self.helper.submit(make), make)

    def rows(self, work: Callable[[int, int], None], height: int) -> None:
        """`work(first, last)` over all rows of a picture; the upper half is offered to the helper."""
        if self.helper is None:
            work(0, height)
            return
        upper = self.offer(lambda: work(0, height // 2))
        work(height // 2, height)
        upper.result()


ALONE = Aside()
"""Nobody helps."""
