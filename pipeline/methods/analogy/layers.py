"""Which layers a job has: those of a shot, or none, when its own inputs are all there is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.errors import BadInput, BadParameter
from pipeline.methods.analogy.params import AnalogyParams
from pipeline.methods.base import Bench
from pipeline.synthesis.tones import Tones
from pipeline.video.archive import number_of
from pipeline.video.shot import LayerFiles, ShotJson, ShotLayout, read_shot
from pipeline.video.shot_files import FRAMES, Files, is_shot

Factors = tuple[float, float, float]
_ELSEWHERE = ("guide_a", "guide_b", "guide_c", "lines", "masks")
"""Inputs of a job that a shot has its own files for."""


@dataclass(frozen=True)
class Layer:
    """A layer with the files of the shot that it falls back on."""

    number: int
    """From back to front; -1 = the whole picture."""
    files: LayerFiles
    whole: LayerFiles
    frames: int
    all: Files
    vectors: Any
    """What shot.json says of how vectors are stored."""

    @property
    def name(self) -> str:
        return self.files.name

    @property
    def where(self) -> str:
        return self.files.where.capitalize()

    @property
    def style(self) -> Mapping[str, str]:
        """Its own style, or else the shot's; never a mixture."""
        return self.files.style if "output" in self.files.style else {**self.whole.style, **self.files.style}

    @property
    def artefact(self) -> str:
        return "tones" if self.number < 0 else f"tones-{self.number}"


@dataclass(frozen=True)
class Found:
    """What the scan has found of a layer."""

    tones: Tones
    factors: Factors | None = None
    """Of its motion vectors; None = it has none."""
    reach_px: float = 0.0

    def arrays(self) -> dict[str, np.ndarray[Any, Any]]:
        factors = np.array(self.factors if self.factors else (), np.float64)
        return {**vars(self.tones), "factors": factors, "reach": np.array(self.reach_px)}

    @staticmethod
    def of(arrays: Mapping[str, np.ndarray[Any, Any]]) -> Found:
        tones = Tones(*(arrays[name] for name in ("lightness", "hue_mean", "hue_spread")))
        factors = tuple(float(f) for f in arrays["factors"])
        return Found(tones, (factors[0], factors[1], factors[2]) if factors else None, float(arrays["reach"]))


@dataclass(frozen=True)
class Shot:
    """A job's shot."""

    whole: Layer
    layers: tuple[Layer, ...]
    says: ShotJson

    def layer(self, number: int) -> Layer:
        return self.whole if number < 0 else self.layers[number]


def shot_of(bench: Bench) -> Shot | None:
    """The shot that the video is, if it is one, or a sequence of EXR images.

    Raises:
        BadInput: inputs that a shot has its own files for.
        UnreadableMedia: see `pipeline.video.shot.read_shot`.
    """
    files = bench.entries("video")
    layout = _layout(files)
    if layout is None:
        return None
    for name in _ELSEWHERE:
        if bench.has(name) or bench.has(f"style_{name}"):
            raise BadInput(
                f"A shot has its {name.replace('_', ' ')} among its files.", field=f"inputs.{name}",
                remedy="Put the pictures in the shot's own folders, and leave this input out.",
            )  # fmt: skip
    if layout.layers and bench.has("keyframes"):
        raise BadInput(
            "A shot with layers has keyframes of its layers.", field="inputs.keyframes",
            remedy="Put them in layers/LAYER/keyframes/.",
        )  # fmt: skip
    files = files if is_shot(files) else _Framed(files)
    whole, says = layout.whole, layout.says
    made = [
        Layer(number, layer, whole, layout.frames, files, says.vectors)
        for number, layer in enumerate((whole, *layout.layers), -1)
    ]
    return Shot(made[0], tuple(made[1:]), says)


def _layout(files: Files) -> ShotLayout | None:
    if not files:
        return None
    if is_shot(files):
        return read_shot(files)
    if not all(name.lower().endswith(".exr") and number_of(name) is not None for name in files):
        return None
    return read_shot(_Framed(files))


class _Framed(dict[str, bytes]):
    """Plain numbered images as the frames of a shot. Contents are read when asked for."""

    def __init__(self, files: Files) -> None:
        super().__init__((f"{FRAMES}/{name.rpartition('/')[2]}", b"") for name in files)
        self._files = {f"{FRAMES}/{name.rpartition('/')[2]}": name for name in files}
        self._source = files

    def __getitem__(self, name: str) -> bytes:
        return self._source[self._files[name]]


def layer_params(params: AnalogyParams, layer: Layer) -> AnalogyParams:
    """The job's parameters with what shot.json changes for a layer.

    Raises:
        BadParameter: an unknown name, a value out of range; by its place in shot.json.
    """
    says = layer.files.says
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
