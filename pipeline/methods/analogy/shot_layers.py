"""Layers of a shot: their files, parameters, statistics and render passes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any, get_args

import numpy as np

from pipeline.arrays import Arrays, State
from pipeline.errors import BadInput, BadParameter
from pipeline.methods.analogy.data_images import (
    Range,
)
from pipeline.methods.analogy.params import AnalogyParams
from pipeline.methods.base import TaskContext
from pipeline.passes.vectors import Factors, Way
from pipeline.synthesis.tone_matching import NO_CONTRASTS, ToneStatistics
from pipeline.video.shot_archive import LayerFiles, ShotJson, sequence_layout
from pipeline.video.shot_files import Files

_WAYS: tuple[Way, ...] = get_args(Way)
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
        scaled: whether smaller frames than those of the files are painted.
    """

    number: int
    files: LayerFiles
    whole: LayerFiles
    frames: int
    contents: Files
    vectors: Any
    scaled: bool = False

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
        factors: factors of its motion vectors; None = no vectors that are used.
        way: to which frame they point.
        reach_px: maximum distance of paint beyond the silhouette, px.
        ranges: values that become 0 and 255 in each guide that has values outside 0..1.
    """

    tones: ToneStatistics
    factors: Factors | None = None
    reach_px: float = 0.0
    ranges: Mapping[str, Range] = field(default_factory=dict)
    way: Way = "both"

    def arrays(self) -> State:
        """The statistics as arrays, for storage."""
        factors = np.array((*self.factors, _WAYS.index(self.way)) if self.factors else (), np.float64)
        ranges = {f"{_RANGE}{name}": np.array(limits, np.float64) for name, limits in self.ranges.items()}
        return {**vars(self.tones), "factors": factors, "reach": np.array(self.reach_px), **ranges}

    @staticmethod
    def of(arrays: Arrays) -> LayerStatistics:
        """Restore what `arrays` returned; statistics of programs before 2026-11-25 have no contrasts."""
        known: dict[str, Any] = {"contrasts": NO_CONTRASTS} | dict(arrays)
        tones = ToneStatistics(*(known[each.name] for each in fields(ToneStatistics)))
        factors = tuple(float(f) for f in arrays["factors"][:3])
        way = _WAYS[int(arrays["factors"][3])] if len(arrays["factors"]) > 3 else "both"
        ranges = {
            name.removeprefix(_RANGE): (float(limits[0]), float(limits[1]))
            for name, limits in arrays.items()
            if name.startswith(_RANGE)
        }
        signs = (factors[0], factors[1], factors[2]) if factors else None
        return LayerStatistics(tones, signs, float(arrays["reach"]), ranges, way)


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
    files = context.passes()
    found = sequence_layout(files) if files else None
    if found is None:
        return None
    layout, files = found
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
    settings, scaled = layout.settings, not context.entries("video")
    whole, *layers = (
        Layer(number, layer, layout.whole, layout.frames, files, settings.vectors, scaled)
        for number, layer in enumerate((layout.whole, *layout.layers), -1)
    )
    return LayeredShot(whole, tuple(layers), settings)


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
