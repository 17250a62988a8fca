"""The jobs that a document describes: one for each shot, or for each variant of a layer. Pure and deterministic."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from pydantic import ValidationError

from pipeline.errors import BadParameter
from pipeline.methods import methods
from pipeline.methods.base import InputSpec, Method
from pipeline.methods.layers import LAYERS
from pipeline.methods.layers.names import MATTE, VIDEO, input_name
from pipeline.video.media import SourceOptions
from workers.contract.request import WARN, Alpha, JobRequest, Json, OutputSpec
from workers.projects.document import Document, Layer, Output, Shot, Variant
from workers.projects.faults import BadProject, Path
from workers.projects.materials import ImagesByFrame, JsonValue, Material, Uploaded
from workers.projects.parsing import structure_faults
from workers.projects.patching import merged


@dataclass(frozen=True)
class Selection:
    """Selects the jobs to submit for a document.

    Attributes:
        shots: ids; None: all.
        variants: ids of variants, each a separate job; then `shots` is ignored.
        frames: a piece of every shot instead of its own range, frame numbers of its video.
        output: output settings that replace the document's.
    """

    shots: Collection[str] | None = None
    variants: Collection[str] = ()
    frames: tuple[int, int] | None = None
    output: Output | None = None
    priority: int = 0


@dataclass(frozen=True)
class Submission:
    """A job of a project whose inputs are not assets yet."""

    shot: str
    variant: str | None
    method: str
    params: Json
    seed: int
    inputs: dict[str, Material]
    output: OutputSpec
    name: str
    frames: tuple[int, int] | None = None
    """[first, end) of the video; None: all of it."""
    priority: int = 0
    on_damage: str = WARN
    source: SourceOptions = field(default_factory=SourceOptions)

    @property
    def content(self) -> str:
        """Digest of what determines the film: equal submissions give equal films. Artefacts and reports do not
        count."""
        output = self.output.format, self.output.quality, self.output.profile, self.output.alpha
        made = {name: (type(one).__name__, vars(one)) for name, one in sorted(self.inputs.items())}
        content = [self.method, self.params, self.seed, made, output, self.frames, self.on_damage, vars(self.source)]
        text = json.dumps(content, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
        return hashlib.sha256(text.encode()).hexdigest()

    def request(self, ids: Mapping[str, str], labels: Mapping[str, str]) -> JobRequest:
        """The job request. `ids`: asset id of every input."""
        return JobRequest(
            self.method, dict(ids), self.params, self.seed, self.output, self.priority, self.name, dict(labels),
            frames=self.frames, on_damage=self.on_damage, source=self.source,
        )  # fmt: skip


@dataclass(frozen=True)
class LayerImages:
    """A shot to be rendered, with the places of its layers in the document."""

    shot: Shot
    path: Path
    layer_paths: tuple[Path, ...]
    variant: str | None = None


def picks(document: Document, selection: Selection = Selection()) -> list[LayerImages]:
    """The shots, or variants of them, that are selected, in the document's order.

    Raises:
        BadProject: an id that the document does not have, or a variant that is no valid layer.
    """
    if selection.variants:
        _known(selection.variants, [variant.id for variant in document.variants], "variants")
        chosen = [(index, v) for index, v in enumerate(document.variants) if v.id in selection.variants]
        return [_variant(document, variant, index) for index, variant in chosen]
    if selection.shots is not None:
        _known(selection.shots, [shot.id for shot in document.shots], "shots")
    found = []
    for index, shot in enumerate(document.shots):
        if selection.shots is None or shot.id in selection.shots:
            path: Path = ("shots", index)
            found.append(LayerImages(shot, path, tuple((*path, "layers", k) for k in range(len(shot.layers)))))
    return found


def submissions(document: Document, selection: Selection = Selection()) -> list[Submission]:
    """The jobs. The document must have no problems (`checking.problems`).

    Raises:
        BadProject: see `picks`.
    """
    return [_submission(document, pick, selection) for pick in picks(document, selection)]


def _submission(document: Document, pick: LayerImages, selection: Selection) -> Submission:
    shot = pick.shot
    frames = selection.frames or shot.range
    output = selection.output or document.output
    layers = shown_layers(shot, output)
    alone = output.layer is not None
    plain = is_plain(layers) and not alone
    work = _one_layer(document, shot, layers[0]) if plain else _layers(document, shot, layers, alone)
    alpha: Alpha = "painted" if alone else output.alpha
    return Submission(
        shot=shot.id,
        variant=pick.variant,
        method=work.method,
        params=work.params,
        seed=work.seed,
        inputs=work.inputs,
        output=OutputSpec(
            output.format,
            output.quality,
            output.artefacts,
            output.report,
            output.profile,
            alpha,
            output.colour,
            output.passes if plain else _layer_passes(layers, output.passes),
            output.passes_format,
        ),
        name=_film_name(document, pick),
        frames=frames,
        priority=selection.priority,
        on_damage=output.on_damage,
        source=shot.source.options(),
    )


def _film_name(document: Document, pick: LayerImages) -> str:
    """Name of a job: the project's name, then the shot's (if it has a name, or the project has several shots) and the
    variant's."""
    shot = pick.shot.name or (pick.shot.id if len(document.shots) > 1 else "")
    variant = next((one.name or one.id for one in document.variants if one.id == pick.variant), "")
    return ": ".join(part for part in (document.name, shot, variant) if part)[:200]


def shown_layers(shot: Shot, output: Output) -> list[Layer]:
    """The layers of a film: the visible ones, or the one that it shows alone."""
    return [layer for layer in shot.layers if (layer.visible if output.layer is None else layer.id == output.layer)]


def is_plain(layers: Sequence[Layer]) -> bool:
    """Whether the only visible layer hides the video, so that the job can use the layer's method directly."""
    return len(layers) == 1 and layers[0].covers


@dataclass(frozen=True)
class _Work:
    """The work of a job: the first members of `Submission`."""

    method: str
    params: Json
    seed: int
    inputs: dict[str, Material]


def _one_layer(document: Document, shot: Shot, layer: Layer) -> _Work:
    return _Work(layer.method, dict(layer.params), layer.seed, layer_inputs(document, shot, layer))


def _layers(document: Document, shot: Shot, layers: Sequence[Layer], alone: bool) -> _Work:
    """A job of the method `layers`; `alone`: of one layer with its opacity."""
    inputs: dict[str, Material] = {VIDEO: Uploaded(document.assets[shot.video].id)}
    for number, layer in enumerate(layers):
        own = layer_inputs(document, shot, layer)
        if layer.source is None:
            del own[VIDEO]
        if layer.matte is not None:
            own[MATTE] = Uploaded(document.assets[layer.matte].id)
        inputs |= {input_name(number, name): material for name, material in own.items()}
    rows = [
        {"method": layer.method, "params": dict(layer.params), "seed": layer.seed, "opacity": layer.opacity,
         "blend": layer.blend, "matted": layer.matte is not None}
        for layer in layers
    ]  # fmt: skip
    return _Work(LAYERS, {"layers": rows} | ({"alone": True} if alone else {}), 0, inputs)


def _layer_passes(layers: Sequence[Layer], wanted: Sequence[str]) -> tuple[str, ...]:
    """Names in a job of the method `layers`: of the layers that make the passes."""
    return tuple(
        input_name(number, made.name)
        for number, layer in enumerate(layers)
        for made in methods()[layer.method].makes_passes
        if made.name in wanted
    )


def layer_inputs(document: Document, shot: Shot, layer: Layer) -> dict[str, Material]:
    """The parts of the document that the layer's method uses, by input name. Frame numbers are the video's. Drawings
    outside the shot's range count, too, because they determine frames in it."""
    chosen = methods()[layer.method]
    found: dict[str, Material] = {"video": Uploaded(document.assets[layer.source or shot.video].id)}
    for spec in chosen.inputs:
        if (material := _material(document, layer, spec)) is not None:
            found[spec.name] = material
    return found


def _material(document: Document, layer: Layer, spec: InputSpec) -> Material | None:
    if spec.name in layer.inputs and spec.name != "video":
        return Uploaded(document.assets[layer.inputs[spec.name]].id)
    if spec.kind != "images":
        value = document_of(methods()[layer.method], spec, layer)
        return None if value is None else JsonValue.of(value)
    images = tuple((frame, document.assets[name].id) for frame, name in sorted(images_of(layer, spec.part).items()))
    return ImagesByFrame(images) if images else None


def images_of(layer: Layer, part: str) -> dict[int, str]:
    """Frame -> asset name of a part of the layer, such as "keys.mask"; drawings without that asset are left out."""
    name, _, member = part.partition(".")
    return {item.frame: image for item in layer.pictures(name) if (image := getattr(item, member)) is not None}


def document_of(chosen: Method, spec: InputSpec, layer: Layer) -> object | None:
    """An input of kind "json" as it is made from a part of the layer; None if there is none."""
    if spec.kind != "json" or spec.part not in layer.parts:
        return None
    make = chosen.part_documents.get(spec.name)
    return (layer.parts[spec.part] if make is None else make(layer.parts[spec.part])) or None


def parts_used(chosen: Method, layer: Layer) -> Iterator[tuple[InputSpec, dict[int, str]]]:
    """The method's inputs that are images by frame, with the layer's images."""
    for spec in chosen.inputs:
        if spec.kind == "images" and spec.part and spec.name not in layer.inputs:
            yield spec, images_of(layer, spec.part)


def _variant(document: Document, variant: Variant, index: int) -> LayerImages:
    s, shot = next((s, shot) for s, shot in enumerate(document.shots) if shot.id == variant.shot)
    changed = tuple(_changed(layer, variant, index) if layer.id == variant.layer else layer for layer in shot.layers)
    paths: list[Path] = [
        ("variants", index, "set") if layer.id == variant.layer else ("shots", s, "layers", k)
        for k, layer in enumerate(shot.layers)
    ]
    return LayerImages(shot.model_copy(update={"layers": changed}), ("shots", s), tuple(paths), variant.id)


def _changed(layer: Layer, variant: Variant, index: int) -> Layer:
    value: Any = merged(layer.model_dump(mode="json"), variant.set)
    try:
        return Layer.model_validate({**value, "visible": True})
    except ValidationError as error:
        raise BadProject(structure_faults(error, ("variants", index, "set"))) from None


def _known(wanted: Iterable[str], known: Collection[str], field_: str) -> None:
    for name in wanted:
        if name not in known:
            raise BadParameter(
                f"Not found among the project's {field_}.", field=field_, value=name,
                remedy=f"There are: {', '.join(known) or 'none'}.",
            )  # fmt: skip
