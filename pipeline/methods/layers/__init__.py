"""layers: several methods at work on one video, their pictures laid over each other.

The platform's own method, for shots of a project that have several visible layers; it is not listed among the published
ones. Step k of the job runs step k of every layer, so that layers are painted side by side; the last step lays their
frames over each other. A layer paints exactly the frames that a job of its method alone would.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from functools import partial
from typing import ClassVar

from pipeline.methods import parse_params
from pipeline.methods.base import AnyParams, Ineffective, InputSpec, MadePass, MakesOpacity, Method, Params, Step
from pipeline.methods.layers.names import COMPOSITE, MATTE, VIDEO, input_name, stage
from pipeline.methods.layers.params import LayerParams, LayersParams
from pipeline.methods.layers.plan import plan_composite, plan_stage, run_composite, run_stage

LAYERS = "layers"
_VIDEO = InputSpec(VIDEO, "video", True, "Video", "The video of the shot.")
_STAGE_VERSION = 1
"""Version of the data that a stage stores in addition to that of its layers' steps."""
_COMPOSITE: Step[AnyParams] = Step(COMPOSITE, "Lay the layers over each other", plan_composite, run_composite, 0.1)


class Layers(Method):
    """See the module's docstring."""

    name: ClassVar[str] = LAYERS
    title: ClassVar[str] = "Layers"
    summary: ClassVar[str] = "Several methods at work on one video, laid over each other."
    paper: ClassVar[str] = ""
    Params: ClassVar[type[Params]] = LayersParams
    inputs: ClassVar[tuple[InputSpec, ...]] = (_VIDEO,)
    passes: ClassVar[tuple[str, ...]] = ("motion",)
    steps: ClassVar[tuple[Step[AnyParams], ...]] = (_COMPOSITE,)
    depth_bits: ClassVar[int] = 16

    def paints_opacity(self, params: AnyParams) -> MakesOpacity:
        return "must" if params.alone else "no"

    def passes_of(self, params: AnyParams) -> tuple[MadePass, ...]:
        """Those of every layer, as "layer0.NAME" from the back."""
        return tuple(
            replace(made, name=input_name(number, made.name))
            for number, layer in enumerate(params.layers)
            for made in layer.chosen.passes_of(parse_params(layer.chosen, layer.params))
        )

    def inputs_of(self, params: AnyParams) -> tuple[InputSpec, ...]:
        """The video, and of each layer its method's inputs, a video of its own and a matte."""
        found = [_VIDEO]
        for number, layer in enumerate(params.layers):
            found += [_layer_input(number, spec) for spec in _inputs(layer)]
        return tuple(found)

    def ineffective(
        self, params: AnyParams, inputs: Collection[str], stream: bool, piece: bool, artefacts: Collection[str] = (),
        passes: Collection[str] = (), video_passes: Collection[str] = (),
    ) -> list[Ineffective]:  # fmt: skip
        """Those of every layer."""
        return [
            replace(found, message=f"Layer {number}: {found.message}")
            for number, layer in enumerate(params.layers)
            for found in layer.chosen.ineffective(
                parse_params(layer.chosen, layer.params),
                _own(inputs, number), stream, piece, (), _own(passes, number),
                () if input_name(number, VIDEO) in inputs else video_passes,
            )
        ]  # fmt: skip

    def steps_of(self, params: AnyParams) -> tuple[Step[AnyParams], ...]:
        """One step for each step of the longest layer plan, then the compositing step."""
        count = max((len(layer.chosen.steps) for layer in params.layers), default=0)
        return (*(_stage(index, count, params) for index in range(count)), _COMPOSITE)


def _own(names: Collection[str], number: int) -> set[str]:
    """The names of a layer's own inputs or passes."""
    return {name.partition(".")[2] for name in names if name.startswith(input_name(number, ""))}


def _inputs(layer: LayerParams) -> tuple[InputSpec, ...]:
    matte = InputSpec(MATTE, "video", False, "Matte", "White where the layer is, black where it is not.")
    return (*layer.chosen.inputs, *([matte] if layer.matted else []))


def _layer_input(number: int, spec: InputSpec) -> InputSpec:
    required = spec.required and spec.name != VIDEO
    needs = input_name(number, spec.needs) if spec.needs else ""
    return replace(spec, name=input_name(number, spec.name), required=required, needs=needs, part="", applies_when=())


def _stage(index: int, count: int, params: AnyParams) -> Step[AnyParams]:
    steps = [layer.chosen.steps[index] for layer in params.layers if index < len(layer.chosen.steps)]
    title = steps[0].title if len({step.title for step in steps}) == 1 else f"Paint the layers, stage {index + 1}"
    version = _STAGE_VERSION + sum(step.version for step in steps)
    return Step(stage(index), title, partial(plan_stage, index), run_stage, sum(step.weight for step in steps), version)


__all__ = ["LAYERS", "LayerParams", "Layers", "LayersParams"]
