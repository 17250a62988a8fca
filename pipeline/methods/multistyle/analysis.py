"""Result of the analysis of one frame, the input of the painter: all strokes, and the orientation field.

A frame can be painted from it without its past, except for the few previous paintings of temporal accumulation. Runs
of frames of one shot can therefore be painted concurrently, in any order.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import AnyArray, Arrays, State, part
from pipeline.frames import Flow, Frame, Plane
from pipeline.kernels.float16 import to_single
from pipeline.methods.multistyle.styles import PIXEL_FIELDS
from pipeline.strokes.brush import Direction, Strokes
from pipeline.strokes.random import Ids
from pipeline.strokes.raster import Profiles
from pipeline.strokes.seeds import StyleField

Half = NDArray[np.float16]

STROKE = np.dtype([
    ("colour", "<f2", (3,)), ("target", "<f2", (3,)), ("radius_px", "<f2"), ("opacity", "<f2"), ("relief_px", "<f2"),
    ("grain", "<f2"), ("length_px", "<f2"), ("presence", "<f2"), ("rank", "<f2"), ("tolerance", "<f2"),
])  # fmt: skip
"""A stroke: paint colour and target colour (RGB 0..255), brush parameters at its seed, presence 0..1, rank in the
painting order (lowest = topmost), and colour tolerance (RGB distance up to which it covers a pixel)."""


@dataclass(frozen=True)
class StrokeLayer:
    """The n strokes of one layer.

    Attributes:
        xy: float32 (n, 2), places of the seeds, px.
        ids: uint64 (n,), identifiers of the seeds.
        strokes: STROKE (n,); rounded to half precision here, so that stored and painted values are the same.
        sigma_px: sigma of the Gaussian blur of the layer's reference, px.
        profile: float32 (n, 6), the technique parameters `PROFILE_FIELDS` of each stroke; (1, 6) = of all.
    """

    xy: NDArray[np.float32]
    ids: Ids
    strokes: AnyArray
    sigma_px: float
    profile: Profiles

    def __len__(self) -> int:
        return len(self.ids)

    def values(self, field: str) -> NDArray[np.float32]:
        """A field of STROKE in single precision."""
        return np.asarray(to_single(self.strokes[field]), np.float32)

    @property
    def topmost_first(self) -> NDArray[np.intp]:
        """Painting order by rank, ties by id; a stroke keeps both for its lifetime."""
        if (self.ids[1:] < self.ids[:-1]).any():
            return np.lexsort((self.ids, self.values("rank")))
        return np.argsort(_ordered_bits(self.strokes["rank"]), kind="stable")

    def dots(self) -> Strokes:
        """The strokes as strokes of one point each."""
        n = len(self)
        return Strokes(
            self.xy.reshape(n, 1, 2), np.ones(n, np.int32), self.values("radius_px"), self.values("colour"),
            self.values("target"), self.values("opacity"), self.values("relief_px"), self.values("grain"), self.ids,
        )  # fmt: skip


@dataclass(frozen=True)
class StrokeAnalysis:
    """All data that the painter needs for one frame.

    Attributes:
        number: counter of the analyzer; consecutive frames of a shot have consecutive numbers.
        picture: uint8 (h', w', 3): the denoised picture, at the frame's size or half of it.
        field: float16 (h', w', 2): (u, v) of the orientation field, coarser than the frame.
        layers: coarse to fine.
        back: float16 (h", w", 2), flow from this frame to the one before, px of `picture`, at a coarser grid; None = a
            shot begins.
        technique: the parameters `PIXEL_FIELDS`: a number, or float16 (h', w').
        rims: uint8 (h', w'), edge darkening, 255 = the style's maximum; None = no style has paper.
        attention: float16, a grid over the frame, 0..1, see `accumulation.Painting`; None = 0.
    """

    number: int
    picture: Frame
    field: Half
    layers: tuple[StrokeLayer, ...]
    back: Half | None
    technique: Mapping[str, float | Half]
    rims: NDArray[np.uint8] | None = None
    attention: Half | None = None

    def direction(self, size: tuple[int, int], out: Direction | None = None) -> Direction:
        """Orientation field for frames of `size` (width, height), float32 (h, w, 2); written to `out` if given."""
        return _resized(self.field, size, out)

    def backward_flow(self) -> Flow | None:
        """Flow to the previous frame at the picture's size, float32, px of the picture; None = a shot begins."""
        return None if self.back is None else _resized(self.back, (self.picture.shape[1], self.picture.shape[0]))

    def pixel_field(self, name: str, size: tuple[int, int]) -> StyleField:
        """A technique parameter for frames of `size`: a number, or float32 (h, w)."""
        found = self.technique[name]
        return found if isinstance(found, float) else _resized(found, size)

    def rim_darkness(self, size: tuple[int, int]) -> Plane:
        """Relative darkening at the rims: float32 (h, w), 0..1."""
        if self.rims is None:
            return np.zeros(size[::-1], np.float32)
        return np.asarray(_resized(self.rims, size) * np.divide(self.pixel_field("rim", size), 255), np.float32)

    def pack(self) -> State:
        """The analysis as arrays by name, for storage."""
        out: State = {
            "picture": self.picture, "field": self.field, "number": np.array(float(self.number)),
        }  # fmt: skip
        if self.back is not None:
            out["back"] = self.back
        if self.rims is not None:
            out["rims"] = self.rims
        if self.attention is not None:
            out["attention"] = self.attention
        for index, layer in enumerate(self.layers):
            out[f"{index}.xy"], out[f"{index}.strokes"], out[f"{index}.ids"] = layer.xy, layer.strokes, layer.ids
            out[f"{index}.sigma"], out[f"{index}.profile"] = np.array(layer.sigma_px), layer.profile
        uniform = {name: value for name, value in self.technique.items() if isinstance(value, float)}
        out["uniform"] = np.array([uniform.get(name, np.nan) for name in PIXEL_FIELDS])
        return out | {
            f"varying-{name}": value for name, value in self.technique.items() if not isinstance(value, float)
        }


def same(some: Sequence[StrokeAnalysis], others: Sequence[StrokeAnalysis]) -> bool:
    """Whether two sequences of analyses are equal, byte for byte."""
    return len(some) == len(others) and all(
        one.keys() == other.keys() and all(one[name].tobytes() == other[name].tobytes() for name in one)
        for one, other in zip((each.pack() for each in some), (each.pack() for each in others), strict=True)
    )


def unpack(arrays: Arrays) -> StrokeAnalysis:
    """Restore what `StrokeAnalysis.pack` returned."""
    count = sum(name.endswith(".xy") for name in arrays)
    layers = tuple(
        StrokeLayer(own["xy"], own["ids"], own["strokes"], float(own["sigma"]), own["profile"])
        for own in (part(arrays, str(k)) for k in range(count))
    )
    technique = {
        name: arrays[f"varying-{name}"] if np.isnan(value) else float(value)
        for name, value in zip(PIXEL_FIELDS, arrays["uniform"], strict=True)
    }
    return StrokeAnalysis(
        int(arrays["number"]), arrays["picture"], arrays["field"], layers, arrays.get("back"), technique,
        arrays.get("rims"), arrays.get("attention"),
    )  # fmt: skip


def _ordered_bits(values: Half) -> NDArray[np.uint16]:
    """Integers in the order of half-precision numbers: NumPy sorts integers of 16 bits by their digits, ten times as
    fast."""
    bits = (values + np.float16(0)).view(np.uint16)  # -0 becomes 0
    return np.where(bits >> 15, ~bits, bits | np.uint16(1 << 15))


def _resized(
    plane: Half | NDArray[np.uint8], size: tuple[int, int], out: NDArray[np.float32] | None = None
) -> NDArray[np.float32]:
    given = to_single(plane) if plane.dtype == np.float16 else plane.astype(np.float32)
    return np.asarray(cv2.resize(given, size, dst=out, interpolation=cv2.INTER_LINEAR), np.float32)
