"""What the eye hands to the painter for one frame: every stroke that is there, and which way strokes run.

With it a frame is painted without a past, but for what lingers of the last few: runs of frames of one shot can be
painted at the same time, in any order.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Flow, Frame, Plane
from pipeline.strokes.brush import Direction, Strokes
from pipeline.strokes.random import Ids

Half = NDArray[np.float16]

COLUMNS = 14
"""Of `Marks.table`: paint RGB, aim RGB, radius, opacity, relief, grain, length, presence, rank, tolerance."""


@dataclass(frozen=True)
class Marks:
    """The strokes of one layer, n of them.

    Attributes:
        xy: float32 (n, 2), where their seeds are, px.
        ids: uint64 (n,), their names.
        table: float16 (n, COLUMNS); rounded once, here, so that what is stored is what is painted.
        sigma_px: of the Gaussian that this layer's reference is blurred with.
    """

    xy: NDArray[np.float32]
    ids: Ids
    table: Half
    sigma_px: float

    def __len__(self) -> int:
        return len(self.ids)

    def column(self, index: int) -> NDArray[np.float32]:
        return self.table[:, index].astype(np.float32)

    @property
    def lengths_px(self) -> NDArray[np.float32]:
        return self.column(10)

    @property
    def presence(self) -> NDArray[np.float32]:
        return self.column(11)

    @property
    def tolerance(self) -> NDArray[np.float32]:
        """How far the picture may be from a stroke's colour for it to cover it, RGB distance."""
        return self.column(13)

    @property
    def uppermost_first(self) -> NDArray[np.intp]:
        """Who covers whom: by rank, equal ones by name. A stroke keeps both for life."""
        return np.lexsort((self.ids, self.column(12)))

    def dots(self) -> Strokes:
        """As strokes of one point each."""
        n = len(self)
        return Strokes(
            self.xy.reshape(n, 1, 2), np.ones(n, np.int32), self.column(6), self.table[:, 0:3].astype(np.float32),
            self.table[:, 3:6].astype(np.float32), self.column(7), self.column(8), self.column(9), self.ids,
        )  # fmt: skip


@dataclass(frozen=True)
class Sight:
    """One frame as the painter needs to know it.

    Attributes:
        number: of the frame, as the eye has counted; a shot's frames follow each other.
        picture: uint8 (h', w', 3): the held picture, perhaps at half the frame's size.
        field: float16 (h', w', 2): (u, v) of the strokes' tensors, coarser than the frame.
        layers: from coarse to fine.
        back: float16 (h", w", 2), from this frame to the one before, px of `picture`, coarser than that; None = a shot
            begins.
        rims: uint8 (h', w'), where wet paint has run to the edge of its area and dried: 255 = as dark as the manner has
            it; None = there is no paper.
    """

    number: int
    picture: Frame
    field: Half
    layers: tuple[Marks, ...]
    back: Half | None
    rims: NDArray[np.uint8] | None = None

    def direction(self, size: tuple[int, int]) -> Direction:
        """float32 (h, w, 2) for frames of `size` (width, height)."""
        return _stretched(self.field, size)

    def way_back(self) -> Flow | None:
        """float32, of the picture's size and in its px; None = a shot begins."""
        return None if self.back is None else _stretched(self.back, (self.picture.shape[1], self.picture.shape[0]))

    def rims_of(self, size: tuple[int, int], most: float) -> Plane:
        """How much darker the rims are, float32 (h, w), 0..`most`."""
        if self.rims is None:
            return np.zeros(size[::-1], np.float32)
        return np.asarray(_stretched(self.rims, size) * np.float32(most / 255), np.float32)

    def pack(self) -> dict[str, NDArray[Any]]:
        """As arrays by name. What is stored costs time: this is little of a painting's, as long as it is small."""
        out: dict[str, NDArray[Any]] = {
            "picture": self.picture, "field": self.field,
            "number": np.array(float(self.number)),
        }  # fmt: skip
        if self.back is not None:
            out["back"] = self.back
        if self.rims is not None:
            out["rims"] = self.rims
        for index, marks in enumerate(self.layers):
            out[f"{index}.xy"], out[f"{index}.table"], out[f"{index}.ids"] = marks.xy, marks.table, marks.ids
            out[f"{index}.sigma"] = np.array(marks.sigma_px)
        return out


def unpack(arrays: Mapping[str, NDArray[Any]]) -> Sight:
    """What `Sight.pack` packed."""
    count = sum(name.endswith(".xy") for name in arrays)
    layers = tuple(
        Marks(arrays[f"{k}.xy"], arrays[f"{k}.ids"], arrays[f"{k}.table"], float(arrays[f"{k}.sigma"]))
        for k in range(count)
    )
    return Sight(
        int(arrays["number"]), arrays["picture"], arrays["field"], layers,
        arrays.get("back"), arrays.get("rims"),
    )  # fmt: skip


def _stretched(plane: Half | NDArray[np.uint8], size: tuple[int, int]) -> NDArray[np.float32]:
    return np.asarray(cv2.resize(plane.astype(np.float32), size, interpolation=cv2.INTER_LINEAR), np.float32)
