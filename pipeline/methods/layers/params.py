"""Parameters of the method `layers`: the layers of a film from back to front."""

from __future__ import annotations

from typing import Any, Self

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from pipeline.compositing import Blend, covers
from pipeline.errors import BadParameter
from pipeline.methods import methods, parse_params
from pipeline.methods.base import Method, Params

MOST_LAYERS = 32


class LayerParams(BaseModel):
    """One layer: a method with its parameters, and the compositing of its picture over the layers below."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    method: str
    params: dict[str, Any] = {}
    seed: int = Field(default=0, ge=0, le=2**53 - 1)
    opacity: float = Field(default=1.0, ge=0, le=1)
    blend: Blend = "over"
    matted: bool = Field(default=False, description="Whether the layer has an input `matte`.")

    @property
    def chosen(self) -> Method:
        return methods()[self.method]

    @property
    def covers(self) -> bool:
        """Whether the layer hides everything below it."""
        return covers(self.opacity, self.blend, self.matted)


class LayersParams(Params):
    """The layers from back to front; the backmost is composited over the video."""

    layers: tuple[LayerParams, ...] = Field(default=(LayerParams(method="abstraction"),), max_length=MOST_LAYERS)

    alone: bool = Field(
        default=False, description="Whether the film shows its one layer with its opacity, without the video behind it."
    )

    @property
    def lead_frames(self) -> int:
        """The most that a layer needs."""
        return max((parse_params(layer.chosen, layer.params).lead_frames for layer in self.layers), default=0)

    def at(self, frame: int) -> Self:
        """The layers with the parameters of one frame."""
        rows = (parse_params(layer.chosen, layer.params).at(frame).model_dump(mode="json") for layer in self.layers)
        layers = zip(self.layers, rows, strict=True)
        return self.model_copy(update={"layers": tuple(one.model_copy(update={"params": row}) for one, row in layers)})

    @field_validator("layers")
    @classmethod
    def _complete(cls, layers: tuple[LayerParams, ...]) -> tuple[LayerParams, ...]:
        """Every layer with all parameters of its method, so that the job means the same after an upgrade."""
        return tuple(_completed(layer, number) for number, layer in enumerate(layers))

    @model_validator(mode="after")
    def _one(self) -> Self:
        if self.alone and len(self.layers) != 1:
            raise ValueError(f"one layer can be alone, and the film has {len(self.layers)}")
        return self


def _completed(layer: LayerParams, number: int) -> LayerParams:
    if layer.method not in methods():
        raise ValueError(f"layer {number}: unknown method {layer.method!r}")
    try:
        params = parse_params(layer.chosen, layer.params)
    except BadParameter as error:
        raise ValueError(f"layer {number}: {error}") from None
    return layer.model_copy(update={"params": params.model_dump(mode="json")})
