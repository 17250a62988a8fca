"""Layers of a shot: their files, parameters, statistics and render passes."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import AnyArray, Arrays, State
from pipeline.errors import BadInput, BadParameter
from pipeline.formats import has_planes
from pipeline.formats.base import Choice, PlaneImage
from pipeline.frames import Flow, Frame, Mask, Plane
from pipeline.methods.analogy.data_images import (
    DEPTH,
    PASSES_IN_FRAMES,
    UNIT,
    Range,
    data_picture,
    direction_data,
    normal_colours,
    plane_data,
)
from pipeline.methods.analogy.inputs import OPAQUE, eight_bit, id_colours
from pipeline.methods.analogy.params import AnalogyParams
from pipeline.methods.base import TaskContext
from pipeline.methods.masks import mask_plane
from pipeline.synthesis.images import Bytes
from pipeline.synthesis.orientation import authored_tensors
from pipeline.synthesis.tone_matching import NO_CONTRASTS, ToneStatistics
from pipeline.video.guard.pictures import guarded_planes, guarded_raw
from pipeline.video.passes import depth, normals, object_ids, picture, raw_vectors
from pipeline.video.shot_archive import LayerFiles, ShotJson, ShotLayout, read_shot
from pipeline.video.shot_files import FRAMES, Files, is_shot
from pipeline.video.stills import over_white

Factors = tuple[float, float, float]
_RANGE = "range-"
_WHOLE_PARAMS = frozenset({"cut_sensitivity"})
_REPLACED_INPUTS = ("guide_a", "guide_b", "guide_c", "lines", "directions", "masks")
"""Inputs of a job that a shot replaces by files of its own."""


@dataclass(frozen=True)
class Layer:
    """One layer; files that it lacks come from the shot as a whole.

    Attributes:
        number: order from back to front; -1 = the whole picture.
        files: paths of the layer's own files.
        whole: paths of the files of the shot as a whole.
        frames: number of frames of the shot.
        contents: bytes of all files of the shot, by path.
        vectors: convention of the motion vectors in shot.json; None = not given.
    """

    number: int
    files: LayerFiles
    whole: LayerFiles
    frames: int
    contents: Files
    vectors: Any

    @property
    def name(self) -> str:
        """Name of the layer in shot.json."""
        return self.files.name

    @property
    def where(self) -> str:
        """Name of the layer for error texts."""
        return self.files.where.capitalize()

    @property
    def style(self) -> Mapping[str, str]:
        """The layer's own style, otherwise the shot's; the two are not mixed."""
        return self.files.style if "output" in self.files.style else {**self.whole.style, **self.files.style}

    @property
    def stylised(self) -> bool:
        """Whether the method paints the layer; False = the layer's own frames are composited unchanged."""
        return self.files.settings is None or self.files.settings.stylise

    @property
    def params(self) -> Mapping[str, Any]:
        """Parameters of the method that shot.json sets for the layer."""
        return {} if self.files.settings is None else self.files.settings.params

    @property
    def statistics_artefact(self) -> str:
        """Name of the artefact with the layer's `LayerStatistics`."""
        return "tones" if self.number < 0 else f"tones-{self.number}"


@dataclass(frozen=True)
class LayerStatistics:
    """Results of the step `scan` for one layer.

    Attributes:
        factors: sign factors of its motion vectors; None = no vectors.
        reach_px: maximum distance of paint beyond the silhouette, px.
        ranges: values that become 0 and 255 in each guide that has values outside 0..1.
    """

    tones: ToneStatistics
    factors: Factors | None = None
    reach_px: float = 0.0
    ranges: Mapping[str, Range] = field(default_factory=dict)

    def arrays(self) -> State:
        """The statistics as arrays, for storage."""
        factors = np.array(self.factors if self.factors else (), np.float64)
        ranges = {f"{_RANGE}{name}": np.array(limits, np.float64) for name, limits in self.ranges.items()}
        return {**vars(self.tones), "factors": factors, "reach": np.array(self.reach_px), **ranges}

    @staticmethod
    def of(arrays: Arrays) -> LayerStatistics:
        """Restore what `arrays` returned; statistics of programs before 2026-11-25 have no contrasts."""
        known: dict[str, Any] = {"contrasts": NO_CONTRASTS} | dict(arrays)
        tones = ToneStatistics(*(known[each.name] for each in fields(ToneStatistics)))
        factors = tuple(float(f) for f in arrays["factors"])
        ranges = {
            name.removeprefix(_RANGE): (float(limits[0]), float(limits[1]))
            for name, limits in arrays.items()
            if name.startswith(_RANGE)
        }
        signs = (factors[0], factors[1], factors[2]) if factors else None
        return LayerStatistics(tones, signs, float(arrays["reach"]), ranges)


@dataclass(frozen=True)
class LayeredShot:
    """A shot: the whole picture and its layers from back to front.

    Attributes:
        settings: contents of shot.json.
    """

    whole: Layer
    layers: tuple[Layer, ...]
    settings: ShotJson

    def layer(self, number: int) -> Layer:
        """The layer `number`; -1 = the whole picture."""
        return self.whole if number < 0 else self.layers[number]


def layered_shot(context: TaskContext[AnalogyParams]) -> LayeredShot | None:
    """The shot in the input `video`; a sequence of images with passes is a shot, too. None = the video is no shot.

    Raises:
        BadInput: the job also has inputs that a shot replaces.
        UnreadableMedia: see `pipeline.video.shot_archive.read_shot`.
    """
    files = context.entries("video")
    layout = _layout(files)
    if layout is None:
        return None
    for name in _REPLACED_INPUTS:
        if context.has(name) or context.has(f"style_{name}"):
            raise BadInput(
                f"A shot contains its {name.replace('_', ' ')}; the separate input is not allowed.",
                field=f"inputs.{name}",
                remedy="Put the pictures into the shot's folders and remove this input.",
            )  # fmt: skip
    if layout.layers and context.has("keyframes"):
        raise BadInput(
            "A shot with layers has keyframes in its layers; the input `keyframes` is not allowed.",
            field="inputs.keyframes",
            remedy="Put them in layers/LAYER/keyframes/.",
        )  # fmt: skip
    files = files if is_shot(files) else _NumberedFrames(files)
    settings = layout.settings
    whole, *layers = (
        Layer(number, layer, layout.whole, layout.frames, files, settings.vectors)
        for number, layer in enumerate((layout.whole, *layout.layers), -1)
    )
    return LayeredShot(whole, tuple(layers), settings)


def _layout(files: Files) -> ShotLayout | None:
    """Layout of a shot; None = the files are no shot."""
    if not files:
        return None
    if is_shot(files):
        return read_shot(files)
    if not all(has_planes(name) and any(c.isdigit() for c in name) for name in files):
        return None
    return read_shot(_NumberedFrames(files))


class _NumberedFrames(dict[str, bytes]):
    """Numbered images presented as the frames of a shot. Contents are read on access."""

    def __init__(self, files: Files) -> None:
        super().__init__((f"{FRAMES}/{name.rpartition('/')[2]}", b"") for name in files)
        self._files = {f"{FRAMES}/{name.rpartition('/')[2]}": name for name in files}
        self._source = files

    def __getitem__(self, name: str) -> bytes:
        return self._source[self._files[name]]


def layer_params(params: AnalogyParams, layer: Layer) -> AnalogyParams:
    """The job's parameters, overridden by the layer's `params` in shot.json.

    Raises:
        BadParameter: an unknown name or a value out of range; the field names the place in shot.json.
    """
    if not layer.params:
        return params
    from pipeline.methods import method, parse_params

    where = f"shot.json: layers.{layer.name}"
    for name in _WHOLE_PARAMS & layer.params.keys():
        raise BadParameter(
            f"The parameter {name} applies to the whole video, not to a layer.", field=f"{where}.params.{name}",
            value=layer.params[name], remedy="Set it for the job.",
        )  # fmt: skip
    try:
        changed = parse_params(method("analogy"), {**params.model_dump(), **layer.params})
    except BadParameter as error:
        raise BadParameter(
            error.message, field=f"{where}.{error.field}", value=error.value, remedy=error.remedy
        ) from None
    assert isinstance(changed, AnalogyParams)
    return changed


def paint_artefact(layer: int, index: int) -> str:
    """Name of the artefact with a layer's painted frame: "rgba", uint8 (h, w, 4), straight alpha."""
    return f"paint-{layer}-{index:07d}"


# -- render passes

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
        self._choice: Choice = getattr(layer.contents, "choice", Choice())
        self._object_ids = layer.files.settings.ids if layer.files.settings else ()
        self.masked = layer.number >= 0 and self._is_part()

    def _is_part(self) -> bool:
        own = self._layer.files.passes
        if own["masks"] or self._object_ids:
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
        own = self._frame(index)
        return over_white(own) if own.shape[2] == 4 and not self.masked else np.ascontiguousarray(own[..., :3])

    def _frame(self, index: int) -> Bytes:
        path = self._paths(FRAMES)[index]
        found = picture(self._planes(path), self._choice) if has_planes(path) else eight_bit(self._raw(path))
        if found is None:
            raise BadInput(
                "The image contains no picture that is known by its name.",
                field=path,
                remedy="Render R, G and B into it.",
            )
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
            return np.asarray(mask_plane(self._data(own["masks"][index])) >= OPAQUE / 255)
        if self._object_ids:
            return np.isin(self.ids(index), self._object_ids)
        return np.asarray(self._frame(index)[..., 3] >= OPAQUE)

    def layer_picture(self, index: int) -> Bytes:
        """The layer's own frame as uint8 (h, w, 4), straight alpha: opacity of its frames, else its silhouette."""
        own = self._frame(index)
        if own.shape[2] == 4 and not self._layer.files.passes["masks"] and not self._object_ids:
            return own
        mask = self.mask(index)
        alpha = np.full(own.shape[:2], 255) if mask is None else np.where(mask, 255, 0)
        return np.dstack([own[..., :3], alpha.astype(np.uint8)])

    def picture(self, kind: str, index: int) -> Frame:
        """Frame `index` of the pass `lines` or `painted`: uint8 (h, w, 3)."""
        return data_picture(self._data(self._paths(kind)[index]))

    def directions(self, index: int) -> Plane:
        """Given directions of the strokes in frame `index`, see `authored_tensors`."""
        return authored_tensors(direction_data(self._layer.contents, self._paths("directions")[index]))

    # -- guides

    def guide_names(self) -> list[str]:
        """Names of the available guides, in a fixed order."""
        folders = {*self._layer.files.guides, *self._layer.whole.guides}
        named = [kind for kind in ("normals", "ids") if self.has(kind) or self._in_frames(kind)]
        return named + sorted(folders | ({DEPTH} if self._in_frames(DEPTH) else set()))

    def guide(self, name: str, index: int, limits: Range = UNIT) -> Frame:
        """A guide as a picture, uint8 (h, w, 3). `limits`: values of its data that become 0 and 255."""
        if name == "ids":
            return id_colours(self.ids(index))
        return self._normals(index) if name == "normals" else data_picture(self.guide_data(name, index), limits)

    def guide_data(self, name: str, index: int) -> AnyArray:
        """The data of the pass `depth` or of a guide with files of its own, see `data_images`."""
        if paths := self._layer.files.guides.get(name) or self._layer.whole.guides.get(name):
            return self._data(paths[index])
        for image in self._images_of(name, index):
            if (found := depth(image)) is not None:
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
            return (raw if raw.ndim == 2 else raw[..., 0]).astype(np.int32)
        for image in self._images_of("ids", index):
            if (found := object_ids(image)) is not None:
                return found
        raise BadInput(
            f"{self._layer.where} is defined by object numbers, but the shot has no pass ids.", field="ids",
            remedy="Put ids/0001.png beside frames/, or render IndexOB into the frames.",
        )  # fmt: skip

    def _normals(self, index: int) -> Frame:
        paths = self._paths("normals")
        if paths and not has_planes(paths[index]):
            return as_rgb(eight_bit(self._raw(paths[index])))
        for image in self._images_of("normals", index):
            if (found := normals(image)) is not None:
                return normal_colours(found)
        raise BadInput(f"{self._layer.where} has no normals in frame {index}.", field="normals",
                       remedy="Render the pass for every frame.")  # fmt: skip

    def _in_frames(self, kind: str) -> bool:
        return any(PASSES_IN_FRAMES[kind](image) is not None for image in self._images_of(kind, 0))

    # -- vectors

    def has_vectors(self) -> bool:
        """Whether the layer has motion vectors in both directions."""
        return all(vectors is not None for vectors in self.vectors(0))

    def vectors(self, index: int) -> tuple[Flow | None, Flow | None]:
        """Vectors as stored: (to the next frame, from the previous frame); None = missing."""
        for image in self._images_of("vectors", index):
            _, forth, back = raw_vectors(image)
            if forth is not None or back is not None:
                return forth, back
        return None, None

    def vector_image(self, index: int) -> PlaneImage:
        """The image that contains the motion vectors of a frame."""
        return next(
            image for image in self._images_of("vectors", index) if any(f is not None for f in raw_vectors(image)[1:])
        )

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
