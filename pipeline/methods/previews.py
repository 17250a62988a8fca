"""Previews of single frames, repainting of frames around a painted key, and checks of documents, for an editor."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Generic, Literal, Protocol

import numpy as np
from numpy.typing import NDArray
from pydantic import JsonValue

from pipeline.arrays import AnyArray, Arrays
from pipeline.frames import Frame, Labels, Mask
from pipeline.methods.fields import P_co
from pipeline.methods.tasks import Task, TaskContext, TaskResult


@dataclass(frozen=True)
class PreviewRequest(Generic[P_co]):
    """Request for a preview of one frame, for methods that implement `Method.preview`.

    Attributes:
        frames: uint8 (height, width, 3), consecutive; the last one is painted, the others precede it.
        number: of the last frame in the video; total: frames of the video.
        documents: inputs of kind "json" by name, parsed.
        images: inputs of kind "images" by name: image by frame number.
        artefacts: archives that an earlier job of the same video made, by artefact name: file by path.
    """

    params: P_co
    seed: int
    frames: Sequence[Frame]
    number: int
    total: int
    documents: Mapping[str, JsonValue] = field(default_factory=dict)
    images: Mapping[str, Mapping[int, AnyArray]] = field(default_factory=dict)
    artefacts: Mapping[str, Mapping[str, bytes]] = field(default_factory=dict)


@dataclass(frozen=True)
class FrameRegions:
    """Regions that a method has found in a frame (`Method.frame_regions`).

    Attributes:
        numbers: int64 (height, width), the region of each pixel, 0 for none; numbers stay the same over the video.
        objects: region -> object that it is a part of.
    """

    numbers: NDArray[np.int64]
    objects: Mapping[int, int]


@dataclass(frozen=True)
class FrameClusters:
    """Clusters of a frame before the film is painted (`Method.frame_clusters`).

    Attributes:
        labels: int32 (h, w), perhaps coarser than the frame: 0 = no cluster, 1 = background.
        uncertainty: of each label, 0..1.
        foreground: bool (h, w), foreground of this frame by the user's masks; None if no mask affects it.
    """

    labels: Labels
    uncertainty: Mapping[int, float]
    foreground: Mask | None = None


FilmPlaneKind = Literal["directions", "regions"]


class FilmTasks(Protocol):
    """The tasks of a film, which run as far as they are asked for. `context` has the film's inputs and size."""

    @property
    def context(self) -> TaskContext[Any]: ...

    def tasks(self, step: str) -> Mapping[str, Task]:
        """Tasks of a step, by key."""

    def results(self, step: str) -> Mapping[str, TaskResult]:
        """Results of the tasks of a step, by key."""

    def load(self, step: str, key: str, name: str) -> Arrays:
        """An artefact of the task `key`; KeyError if it saves none of this name."""


@dataclass(frozen=True)
class FilmPlane:
    """Regions or stroke directions that the film uses in a frame (`Method.film_plane`).

    Attributes:
        plane: of kind "directions": float32 (h', w', 2), angle in [0, pi), clockwise from x, and strength >= 0; of kind
            "regions": uint8 (h', w'), the region of each pixel. Perhaps coarser than the frame.
        names: of the regions, by their number.
        moved: of kind "directions": what the design sets at this time, by region, as in one of its keys at this frame.
    """

    plane: AnyArray
    names: tuple[str, ...] = ()
    moved: Mapping[str, JsonValue] = field(default_factory=dict)


class KeyPropagator(Protocol):
    """Repaints the frames around a painted key while a user edits it (`Method.propagator`).

    It keeps data that an edit does not change, such as motion and earlier results, between calls. Not thread-safe: one
    call of `prepare`, or one iteration over `repaint`, at a time. An iteration may be abandoned at any frame.
    """

    @property
    def size_bytes(self) -> int:
        """Bytes of main memory that are kept between calls."""
        ...

    def prepare(self, key: int, around: int) -> None:
        """Compute in advance the data that `repaint` needs besides the painting.

        Args:
            key: index of the key among the frames.
            around: frames on each side of it.
        """
        ...

    def repaint(self, key: int, image: NDArray[np.uint8], around: int) -> Iterator[tuple[int, Frame]]:
        """(index, picture) of the key, then of the frames around it, nearest first; uint8 (height, width, 3).

        Args:
            image: the painted key, uint8 (height, width, 3) or, with opacity, (height, width, 4), of the frames' size.
                The key's own picture equals it where it is opaque; the method fills its transparent pixels.
        """
        ...


@dataclass(frozen=True)
class InputFault:
    """A fault in a JSON input of a method.

    Attributes:
        path: members and indices from the document's root.
    """

    path: tuple[str | int, ...]
    message: str
    value: object = None
    remedy: str = ""


class InputCheck(Protocol):
    """Checks a JSON input of a method before a job runs."""

    def __call__(self, document: object, *, frames: int | None, masks: bool | None) -> Sequence[InputFault]:
        """Find all faults of the document.

        Args:
            frames: frame count of the video; None: frame numbers are not checked.
            masks: whether the method's label maps are given; None: unknown.
        """
        ...
