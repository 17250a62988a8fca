"""Decoded passes of a layer: from separate files, from channels of its EXR frames, or from those of the shot."""

from __future__ import annotations

from collections import OrderedDict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import BadInput
from pipeline.frames import Flow, Frame, Mask
from pipeline.methods.analogy.keyframes import OPAQUE, eight_bit
from pipeline.methods.analogy.layers import Layer
from pipeline.methods.analogy.sources import id_colours
from pipeline.synthesis.images import Bytes
from pipeline.video.exr import EXR_MAGIC, Exr, normals, object_ids, pixels, raw_vectors
from pipeline.video.guard.pictures import guarded_exr, guarded_raw
from pipeline.video.shot_files import FRAMES

_KEPT = 3
"""Number of decoded EXR images in the cache: a frame and its two neighbours."""


class Passes:
    """Reads the passes of a layer frame by frame."""

    def __init__(self, layer: Layer, size: tuple[int, int]) -> None:
        self._layer, self._size = layer, size
        self._images: OrderedDict[str, Exr] = OrderedDict()
        self._says_ids = layer.files.settings.ids if layer.files.settings else ()
        self.masked = layer.number >= 0 and self._is_part()

    def _is_part(self) -> bool:
        own = self._layer.files.passes
        if own["masks"] or self._says_ids:
            return True
        return bool(own[FRAMES]) and self._frame(0).shape[2] == 4

    def has(self, kind: str) -> bool:
        return bool(self._paths(kind))

    def _paths(self, kind: str) -> Any:
        return self._layer.files.passes[kind] or self._layer.whole.passes[kind]

    # -- pictures

    def frame(self, index: int) -> Frame:
        return np.ascontiguousarray(self._frame(index)[..., :3])

    def _frame(self, index: int) -> Bytes:
        path = self._paths(FRAMES)[index]
        found = pixels(self._exr(path)) if self._is_exr(path) else eight_bit(self._raw(path))
        if found is None:
            raise BadInput("The EXR file contains no picture.", field=path, remedy="Render R, G and B into it.")
        sized = np.dstack([found] * 3) if found.ndim == 2 else found
        if (sized.shape[1], sized.shape[0]) != self._size:
            raise BadInput(
                f"{self._layer.where} has a frame of a different size.", field=path,
                value=f"{sized.shape[1]}x{sized.shape[0]}", remedy=f"Make it {self._size[0]}x{self._size[1]}.",
            )  # fmt: skip
        return sized

    def mask(self, index: int) -> Mask | None:
        """Silhouette of the layer from its masks, its objects, or the opacity of its frames; None = everywhere."""
        if not self.masked:
            return None
        own = self._layer.files.passes
        if own["masks"]:
            eight = eight_bit(self._raw(own["masks"][index]))
            return np.asarray((eight if eight.ndim == 2 else eight[..., 0]) >= OPAQUE)
        if self._says_ids:
            return np.isin(self.ids(index), self._says_ids)
        return np.asarray(self._frame(index)[..., 3] >= OPAQUE)

    def lines(self, index: int) -> Frame:
        eight = eight_bit(self._raw(self._paths("lines")[index]))
        return np.dstack([eight] * 3) if eight.ndim == 2 else np.ascontiguousarray(eight[..., :3])

    # -- guides

    def guide_names(self) -> list[str]:
        """Names of the available guides, in a fixed order."""
        named = [kind for kind in ("normals", "ids") if self.has(kind) or self._in_frames(kind)]
        return named + sorted({*self._layer.files.guides, *self._layer.whole.guides})

    def guide(self, name: str, index: int) -> Frame:
        """A guide as a picture, uint8 (h, w, 3)."""
        if name == "ids":
            return id_colours(self.ids(index))
        if name == "normals":
            return self._normals(index)
        paths = self._layer.files.guides.get(name) or self._layer.whole.guides[name]
        eight = eight_bit(self._raw(paths[index]))
        return np.dstack([eight] * 3) if eight.ndim == 2 else np.ascontiguousarray(eight[..., :3])

    def ids(self, index: int) -> NDArray[np.int32]:
        """Object number of each pixel, int32 (h, w).

        Raises:
            BadInput: the layer has no pass `ids`.
        """
        paths = self._paths("ids")
        if paths and not self._is_exr(paths[index]):
            raw = self._raw(paths[index])
            return (raw if raw.ndim == 2 else raw[..., 0]).astype(np.int32)
        for exr in self._images_of("ids", index):
            if (found := object_ids(exr)) is not None:
                return found
        raise BadInput(
            f"{self._layer.where} is defined by object numbers, but the shot has no pass ids.", field="ids",
            remedy="Put ids/0001.png beside frames/, or render IndexOB into the EXR frames.",
        )  # fmt: skip

    def _normals(self, index: int) -> Frame:
        paths = self._paths("normals")
        if paths and not self._is_exr(paths[index]):
            eight = eight_bit(self._raw(paths[index]))
            return np.dstack([eight] * 3) if eight.ndim == 2 else np.ascontiguousarray(eight[..., :3])
        for exr in self._images_of("normals", index):
            if (found := normals(exr)) is not None:
                return np.asarray(np.rint((np.nan_to_num(found).clip(-1, 1) + 1) * 127.5), np.uint8)
        raise BadInput(f"{self._layer.where} has no normals in frame {index}.", field="normals",
                       remedy="Render the pass for every frame.")  # fmt: skip

    def _in_frames(self, kind: str) -> bool:
        find = normals if kind == "normals" else object_ids
        return any(find(exr) is not None for exr in self._images_of(kind, 0))

    # -- vectors

    def has_vectors(self) -> bool:
        """Whether the layer has motion vectors in both directions."""
        return all(field is not None for field in self.vectors(0))

    def vectors(self, index: int) -> tuple[Flow | None, Flow | None]:
        """Vectors as stored: (to the next frame, from the previous frame); None = missing."""
        for exr in self._images_of("vectors", index):
            _, forth, back = raw_vectors(exr)
            if forth is not None or back is not None:
                return forth, back
        return None, None

    def vector_image(self, index: int) -> Exr:
        """The EXR image that contains the motion vectors of a frame."""
        return next(
            exr for exr in self._images_of("vectors", index) if any(f is not None for f in raw_vectors(exr)[1:])
        )

    def _images_of(self, kind: str, index: int) -> list[Exr]:
        """EXR images that may contain a pass, the most likely first."""
        own, whole = self._layer.files.passes, self._layer.whole.passes
        paths = [p[k][index] for p in (own, whole) for k in (kind, FRAMES) if index in p.get(k, {})]
        return [self._exr(path) for path in dict.fromkeys(paths) if self._is_exr(path)]

    # -- files

    def _raw(self, path: str) -> NDArray[Any]:
        return guarded_raw(self._layer.all[path], path)

    @staticmethod
    def _is_exr(path: str) -> bool:
        return path.lower().endswith(".exr")

    def _exr(self, path: str) -> Exr:
        if path not in self._images:
            data = self._layer.all[path]
            if not data.startswith(EXR_MAGIC):
                raise BadInput(
                    "The file is named .exr but is not an OpenEXR file.", field=path, remedy="Save it as OpenEXR."
                )
            self._images[path] = guarded_exr(data, path)
            if len(self._images) > _KEPT:
                self._images.popitem(last=False)
        return self._images[path]
