"""Render passes of a layer of a shot, frame by frame."""

from __future__ import annotations

from collections import OrderedDict
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import AnyArray
from pipeline.errors import BadInput
from pipeline.formats import has_planes
from pipeline.formats.base import Choice, PlaneImage
from pipeline.frames import Flow, Frame, Mask, Plane
from pipeline.methods.analogy.data_images import (
    FLOAT_PASSES,
    PASSES_IN_FRAMES,
    UNIT,
    Range,
    data_picture,
    direction_data,
    normal_colours,
    plane_data,
)
from pipeline.methods.analogy.inputs import OPAQUE, eight_bit, id_colours
from pipeline.methods.analogy.shot_layers import Layer
from pipeline.methods.masks import mask_plane
from pipeline.passes.cryptomatte import cryptomattes
from pipeline.passes.find import Where, normals
from pipeline.passes.sequence import labels_of
from pipeline.passes.vectors import Factors, VectorFacts, Way, completed, of_pair, vector_pass
from pipeline.synthesis.images import Bytes
from pipeline.synthesis.orientation import authored_tensors
from pipeline.video.guard.pictures import guarded_planes, guarded_raw
from pipeline.video.passes import picture, picture_choice, samples, settled_choice
from pipeline.video.sequence_options import USUAL, SequenceOptions
from pipeline.video.shot_files import FRAMES
from pipeline.video.stills import over_white

_MAX_CACHED = 3
"""Number of decoded images with planes in memory: a frame and its two neighbours."""


class RenderPasses:
    """Reads the render passes of a layer frame by frame.

    A pass comes from separate files, from channels of the layer's frames, or from those of the shot.

    Attributes:
        masked: whether the layer covers only a part of the picture.
    """

    def __init__(self, layer: Layer, size: tuple[int, int]) -> None:
        self._layer, self._size = layer, size
        self._images: OrderedDict[str, PlaneImage] = OrderedDict()
        self._options: SequenceOptions = getattr(layer.contents, "options", USUAL)
        self._object_ids = layer.files.settings.ids if layer.files.settings else ()
        self._objects = layer.files.settings.objects if layer.files.settings else ()
        self.masked = layer.number >= 0 and self._is_part()

    @cached_property
    def ratio(self) -> float:
        """Size of the painted frames relative to that of the files."""
        return self._size[0] / self._own_frame(0).shape[1] if self._layer.scaled else 1.0

    @cached_property
    def _choice(self) -> Choice:
        """Which picture of the layer's frames is read."""
        paths, wanted = self._paths(FRAMES), self._options.choice
        if not has_planes(paths[0]):
            return wanted
        images = (self._planes(paths[index]) for index in samples(len(paths)))
        return settled_choice(wanted, self._planes(paths[0]), lambda: images)[0]

    def where(self, image: PlaneImage) -> Where:
        """Where the passes of an image are: beside its picture."""
        return Where(picture_choice(image, self._choice).layer, self._choice.view)

    def _is_part(self) -> bool:
        own = self._layer.files.passes
        if own["masks"] or self._object_ids or self._objects:
            return True
        return bool(own[FRAMES]) and self._frame(0).shape[2] == 4

    def has(self, kind: str) -> bool:
        """Whether the layer or the shot has separate files of a pass."""
        return bool(self._paths(kind))

    def _paths(self, kind: str) -> Any:
        return self._layer.files.passes[kind] or self._layer.whole.passes[kind]

    # -- pictures

    def frame(self, index: int) -> Frame:
        """Frame `index` of the layer: uint8 (h, w, 3). A whole frame with opacity is composited over white."""
        return self._without_opacity(self._frame(index))

    def stored_frame(self, index: int) -> Frame:
        """`frame` at the size of its file, which is that of the other passes."""
        return self._without_opacity(self._own_frame(index))

    def _without_opacity(self, own: Bytes) -> Frame:
        return over_white(own) if own.shape[2] == 4 and not self.masked else np.ascontiguousarray(own[..., :3])

    def _own_frame(self, index: int) -> Bytes:
        """Frame `index` as it is stored, uint8 (h, w, 3) or with opacity."""
        path = self._paths(FRAMES)[index]
        found = picture(self._planes(path), self._choice) if has_planes(path) else eight_bit(self._raw(path))
        if found is None:
            raise BadInput(
                "The image contains no picture that is known by its name.",
                field=path,
                remedy="Render R, G and B into it.",
            )
        sized = np.dstack([found] * 3) if found.ndim == 2 else found
        if (sized.shape[1], sized.shape[0]) != self._size and not self._layer.scaled:
            raise BadInput(
                f"{self._layer.where} has a frame of a different size.", field=path,
                value=f"{sized.shape[1]}x{sized.shape[0]}", remedy=f"Make it {self._size[0]}x{self._size[1]}.",
            )  # fmt: skip
        return np.asarray(sized)

    def _frame(self, index: int) -> Bytes:
        return np.asarray(self.fitted(self._own_frame(index)), np.uint8)

    def fitted(self, image: AnyArray, mixed: bool = True) -> AnyArray:
        """An image at the size of the frames, if these are smaller than the files: averaged, or not `mixed` where
        values are numbers."""
        if image.shape[1::-1] == self._size or not self._layer.scaled:
            return image
        return np.asarray(cv2.resize(image, self._size, interpolation=cv2.INTER_AREA if mixed else cv2.INTER_NEAREST))

    def mask(self, index: int) -> Mask | None:
        """Silhouette of the layer from its masks, its objects, or the opacity of its frames; None = everywhere."""
        if not self.masked:
            return None
        own = self._layer.files.passes
        if own["masks"]:
            return np.asarray(self.fitted(mask_plane(self._data(own["masks"][index]))) >= OPAQUE / 255)
        if self._objects:
            return np.asarray(self.matte(index) >= OPAQUE / 255)
        if self._object_ids:
            return np.isin(self.ids(index), self._object_ids)
        return np.asarray(self._frame(index)[..., 3] >= OPAQUE)

    def matte(self, index: int) -> Plane:
        """Coverage of the layer's objects by the Cryptomatte, float32 (h, w), 0..1.

        Raises: BadInput: there is no Cryptomatte, or no object of a name.
        """
        for image in self._images_of("ids", index):
            if found := cryptomattes(image, self.where(image)):
                return np.asarray(self.fitted(found[0].matte(image, *self._objects)), np.float32)
        raise BadInput(
            f"{self._layer.where} is defined by names of objects, but the shot has no Cryptomatte.", field="objects",
            value=", ".join(self._objects), remedy="Render the pass into the frames.",
        )  # fmt: skip

    def layer_picture(self, index: int) -> Bytes:
        """The layer's own frame as uint8 (h, w, 4), straight alpha: opacity of its frames, else its silhouette."""
        own = self._frame(index)
        if self._objects:
            return np.dstack([own[..., :3], np.rint(self.matte(index) * 255).astype(np.uint8)])
        if own.shape[2] == 4 and not self._layer.files.passes["masks"] and not self._object_ids:
            return own
        mask = self.mask(index)
        alpha = np.full(own.shape[:2], 255) if mask is None else np.where(mask, 255, 0)
        return np.dstack([own[..., :3], alpha.astype(np.uint8)])

    def picture(self, kind: str, index: int) -> Frame:
        """Frame `index` of the pass `lines` or `painted`: uint8 (h, w, 3)."""
        return np.asarray(self.fitted(data_picture(self._data(self._paths(kind)[index]))), np.uint8)

    def directions(self, index: int) -> Plane:
        """Given directions of the strokes in frame `index`, see `authored_tensors`."""
        stored = authored_tensors(direction_data(self._layer.contents, self._paths("directions")[index]))
        return np.asarray(self.fitted(stored), np.float32)

    # -- guides

    def guide_names(self) -> list[str]:
        """Names of the available guides, in a fixed order."""
        folders = {*self._layer.files.guides, *self._layer.whole.guides}
        named = [kind for kind in ("normals", "ids") if self.has(kind) or self._in_frames(kind)]
        return named + sorted(folders | {name for name in FLOAT_PASSES if self._in_frames(name)})

    def guide(self, name: str, index: int, limits: Range = UNIT) -> Frame:
        """A guide as a picture, uint8 (h, w, 3). `limits`: values of its data that become 0 and 255."""
        if name == "ids":
            return id_colours(self.ids(index))
        found = self._normals(index) if name == "normals" else data_picture(self.guide_data(name, index), limits)
        return np.asarray(self.fitted(found), np.uint8)

    def guide_data(self, name: str, index: int) -> AnyArray:
        """The data of one of `FLOAT_PASSES` or of a guide with files of its own, see `data_images`."""
        if paths := self._layer.files.guides.get(name) or self._layer.whole.guides.get(name):
            return self._data(paths[index])
        for image in self._images_of(name, index):
            if name in PASSES_IN_FRAMES and (found := PASSES_IN_FRAMES[name](image, self.where(image))) is not None:
                return found
        raise BadInput(f"{self._layer.where} has no {name} in frame {index}.", field=name,
                       remedy="Render the pass for every frame.")  # fmt: skip

    def ids(self, index: int) -> NDArray[np.int32]:
        """Object number of each pixel, int32 (h, w).

        Raises:
            BadInput: the layer has no pass `ids`.
        """
        paths = self._paths("ids")
        if paths and not has_planes(paths[index]):
            raw = self._raw(paths[index])
            return np.asarray(self.fitted((raw if raw.ndim == 2 else raw[..., 0]).astype(np.int32), False))
        for image in self._images_of("ids", index):
            if (found := labels_of(image, self.where(image))) is not None:
                return np.asarray(self.fitted(found, False))
        raise BadInput(
            f"{self._layer.where} is defined by object numbers, but the shot has no pass ids.", field="ids",
            remedy="Put ids/0001.png beside frames/, or render the object index or Cryptomatte into the frames.",
        )  # fmt: skip

    def _normals(self, index: int) -> Frame:
        paths = self._paths("normals")
        if paths and not has_planes(paths[index]):
            return as_rgb(eight_bit(self._raw(paths[index])))
        for image in self._images_of("normals", index):
            if (found := normals(image, self.where(image))) is not None:
                return normal_colours(found)
        raise BadInput(f"{self._layer.where} has no normals in frame {index}.", field="normals",
                       remedy="Render the pass for every frame.")  # fmt: skip

    def _in_frames(self, kind: str) -> bool:
        images = self._images_of(kind, 0)
        return any(PASSES_IN_FRAMES[kind](image, self.where(image)) is not None for image in images)

    # -- vectors

    def has_vectors(self) -> bool:
        """Whether the layer has motion vectors."""
        return any(vector_pass(image, self.where(image)) is not None for image in self._images_of("vectors", 0))

    def vector_image(self, index: int) -> PlaneImage:
        """The image that contains the motion vectors of a frame. Raises BadInput: there is none."""
        for image in self._images_of("vectors", index):
            if vector_pass(image, self.where(image)) is not None:
                return image
        raise BadInput(f"{self._layer.where} has no motion vectors in frame {index}.", field="vectors",
                       remedy="Render the pass for every frame.")  # fmt: skip

    def velocities(self, first: int, factors: Factors, way: Way) -> tuple[Flow, Flow]:
        """V+ of a frame and V- of the next one, see `pipeline.passes.vectors`; one-way vectors are completed."""
        images = self.vector_image(first), self.vector_image(first + 1)
        facts = VectorFacts("", "", way, factors)
        found = of_pair(facts, *images, self.where(images[0]))
        plus, minus = completed(found, self.stored_frame(first), self.stored_frame(first + 1))
        if not self._layer.scaled:
            return plus, minus
        scale = np.divide(self._size, plus.shape[1::-1]).astype(np.float32)
        return self.fitted(plus, False) * scale, self.fitted(minus, False) * scale

    def _images_of(self, kind: str, index: int) -> list[PlaneImage]:
        """Images that may contain a pass, the most likely first."""
        own, whole = self._layer.files.passes, self._layer.whole.passes
        paths = [p[k][index] for p in (own, whole) for k in (kind, FRAMES) if index in p.get(k, {})]
        return [self._planes(path) for path in dict.fromkeys(paths) if has_planes(path)]

    # -- files

    def _raw(self, path: str) -> AnyArray:
        return guarded_raw(self._layer.contents[path], path)

    def _data(self, path: str) -> AnyArray:
        return plane_data(self._planes(path), path) if has_planes(path) else self._raw(path)

    def _planes(self, path: str) -> PlaneImage:
        if path not in self._images:
            self._images[path] = guarded_planes(self._layer.contents[path], path)
            if len(self._images) > _MAX_CACHED:
                self._images.popitem(last=False)
        return self._images[path]


def as_rgb(image: AnyArray) -> AnyArray:
    """Convert a gray, RGB or RGBA image to RGB: (h, w, 3), same dtype."""
    return np.dstack([image] * 3) if image.ndim == 2 else np.ascontiguousarray(image[..., :3])
