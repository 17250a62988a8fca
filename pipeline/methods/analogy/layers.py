"""Layers of a shot: their files, parameters and statistics."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.errors import BadInput, BadParameter
from pipeline.methods.analogy.params import AnalogyParams
from pipeline.methods.base import TaskContext
from pipeline.synthesis.tone_matching import ToneStatistics
from pipeline.video.archive import number_of
from pipeline.video.shot import LayerFiles, ShotJson, ShotLayout, read_shot
from pipeline.video.shot_files import FRAMES, Files, is_shot

Factors = tuple[float, float, float]
_ELSEWHERE = ("guide_a", "guide_b", "guide_c", "lines", "masks")
"""Inputs of a job that a shot replaces by files of its own."""


@dataclass(frozen=True)
class Layer:
    """One layer; files that it lacks come from the shot as a whole."""

    number: int
    """Order from back to front; -1 = the whole picture."""
    files: LayerFiles
    whole: LayerFiles
    frames: int
    all: Files
    vectors: Any
    """Vector convention of shot.json."""

    @property
    def name(self) -> str:
        return self.files.name

    @property
    def where(self) -> str:
        return self.files.where.capitalize()

    @property
    def style(self) -> Mapping[str, str]:
        """The layer's own style, otherwise the shot's; the two are not mixed."""
        return self.files.style if "output" in self.files.style else {**self.whole.style, **self.files.style}

    @property
    def artefact(self) -> str:
        return "tones" if self.number < 0 else f"tones-{self.number}"


@dataclass(frozen=True)
class LayerStatistics:
    """Results of the step `scan` for one layer."""

    tones: ToneStatistics
    factors: Factors | None = None
    """Sign factors of its motion vectors; None = no vectors."""
    reach_px: float = 0.0

    def arrays(self) -> dict[str, np.ndarray[Any, Any]]:
        factors = np.array(self.factors if self.factors else (), np.float64)
        return {**vars(self.tones), "factors": factors, "reach": np.array(self.reach_px)}

    @staticmethod
    def of(arrays: Mapping[str, np.ndarray[Any, Any]]) -> LayerStatistics:
        tones = ToneStatistics(*(arrays[name] for name in ("lightness", "hue_mean", "hue_spread")))
        factors = tuple(float(f) for f in arrays["factors"])
        return LayerStatistics(tones, (factors[0], factors[1], factors[2]) if factors else None, float(arrays["reach"]))


@dataclass(frozen=True)
class LayeredShot:
    """A shot: the whole picture and its layers from back to front."""

    whole: Layer
    layers: tuple[Layer, ...]
    says: ShotJson

    def layer(self, number: int) -> Layer:
        return self.whole if number < 0 else self.layers[number]


def layered_shot(context: TaskContext[AnalogyParams]) -> LayeredShot | None:
    """The shot given as the input `video`; a sequence of EXR images counts as one. None = the video is no shot.

    Raises:
        BadInput: the job also has inputs that a shot replaces.
        UnreadableMedia: see `pipeline.video.shot.read_shot`.
    """
    files = context.entries("video")
    layout = _layout(files)
    if layout is None:
        return None
    for name in _ELSEWHERE:
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
    files = files if is_shot(files) else _Framed(files)
    whole, says = layout.whole, layout.settings
    made = [
        Layer(number, layer, whole, layout.frames, files, says.vectors)
        for number, layer in enumerate((whole, *layout.layers), -1)
    ]
    return LayeredShot(made[0], tuple(made[1:]), says)


def _layout(files: Files) -> ShotLayout | None:
    if not files:
        return None
    if is_shot(files):
        return read_shot(files)
    if not all(name.lower().endswith(".exr") and number_of(name) is not None for name in files):
        return None
    return read_shot(_Framed(files))


class _Framed(dict[str, bytes]):
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
    says = layer.files.settings
    if says is None or not says.params:
        return params
    from pipeline.methods import method, parse_params

    try:
        changed = parse_params(method("analogy"), {**params.model_dump(), **says.params})
    except BadParameter as error:
        raise BadParameter(
            error.message, field=f"shot.json: layers.{layer.name}.{error.field}", value=error.value, remedy=error.remedy
        ) from None
    assert isinstance(changed, AnalogyParams)
    return changed


def paint_name(layer: int, index: int) -> str:
    """Name of the artefact with a layer's painted frame: "rgba", uint8 (h, w, 4), straight alpha."""
    return f"paint-{layer}-{index:07d}"
