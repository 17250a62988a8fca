"""Finds the problems that keep a document from being rendered, with their locations. Such a document can be saved."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from pipeline.errors import BadParameter
from pipeline.formats import PASS_FORMATS
from pipeline.methods import methods, param_faults
from pipeline.methods.base import InputSpec, Method, missing_inputs
from workers.contract.record import Asset
from workers.jobs.frame_window import check_source, window_info
from workers.projects.document import Document, Layer, Shot
from workers.projects.faults import BadProject, DocumentFault, Path, fault, fault_at
from workers.projects.submissions import (
    LayerImages,
    Selection,
    document_of,
    images_of,
    is_plain,
    parts_used,
    picks,
    shown_layers,
)
from workers.scheduling.check_request import FITS


def problems(
    document: Document, assets: Mapping[str, Asset], selection: Selection = Selection()
) -> list[DocumentFault]:
    """Every problem of the selected shots.

    Args:
        assets: id -> asset, for those of `document.asset_ids` that the owner has.
    """
    try:
        chosen = picks(document, selection)
    except BadProject as error:
        return list(error.errors)
    found = [problem for pick in chosen for problem in _Check(document, assets, selection, pick).shot()]
    if not chosen:
        found.append(fault(("shots",), "The project has no shots.", remedy="Add a video."))
    return list(dict.fromkeys(found))


def shot_problems(
    document: Document, assets: Mapping[str, Asset], shot: Shot, index: int, layers: Sequence[int]
) -> list[DocumentFault]:
    """Problems of some layers of one shot, as previews see them.

    Args:
        shot: the shot with only these layers.
        index: the shot's number in the document.
        layers: the layers' numbers in the shot.
    """
    path: Path = ("shots", index)
    pick = LayerImages(shot, path, tuple((*path, "layers", k) for k in layers))
    return list(dict.fromkeys(_Check(document, assets, Selection(), pick, jobs=False).shot()))


class _Check:
    """Checks one shot. `jobs`: whether to include problems that matter only to jobs."""

    def __init__(
        self,
        document: Document,
        assets: Mapping[str, Asset],
        selection: Selection,
        pick: LayerImages,
        jobs: bool = True,
    ) -> None:
        self._document, self._assets, self._pick = document, assets, pick
        self._output = selection.output or document.output
        self._frames = selection.frames
        self._jobs = jobs

    def shot(self) -> Iterator[DocumentFault]:
        shot, path = self._pick.shot, self._pick.path
        video = self._asset(shot.video)
        yield from self._check_stored(shot.video, (*path, "video"))
        if video is not None and video.kind not in FITS["video"]:
            yield fault((*path, "video"), f"This asset is no video: it is {video.kind}.", value=video.id,
                        remedy="Name a video, an image or a zip of numbered images.")  # fmt: skip
        if video is not None:
            try:
                source = shot.source.options()
                check_source(source, video.info)
                video = replace(video, info=window_info(video.info, None, source))
            except BadParameter as wrong:
                yield fault_at((*path, *wrong.field.split(".")), wrong)
        count = self._count(video)
        span = self._frames or shot.range
        if span is not None and span[0] >= span[1]:
            yield fault((*path, "range"), "The range has no frame.", value=span, remedy="End after its first frame.")
        if span is not None and count is not None and span[1] > count:
            yield fault((*path, "range"), f"The video has {count} frames.", value=span, remedy=f"End at {count}.")
        shown = shown_layers(shot, self._output) if self._jobs else [layer for layer in shot.layers if layer.visible]
        alone = self._output.layer is not None
        if not shown and alone:
            yield fault(("output", "layer"), "The shot has no such layer.", value=self._output.layer,
                        remedy=f"It has: {', '.join(layer.id for layer in shot.layers) or 'none'}.")  # fmt: skip
        elif not shown:
            yield fault((*path, "layers"), "The shot has no visible layer.", remedy="Add a layer, or show one.")
        if self._jobs and self._output.artefacts and (alone or not is_plain(shown)):
            remedy = "Ask for none, or show one layer at full opacity."
            message = "A film of several layers has no artefacts."
            yield fault(("output", "artefacts"), message, value=self._output.artefacts, remedy=remedy)
        if self._jobs:
            yield from self._passes(shown)
        for layer, at in zip(shot.layers, self._pick.layer_paths, strict=True):
            if layer in shown:
                yield from self._layer(layer, at, video, count)

    def _passes(self, shown: list[Layer]) -> Iterator[DocumentFault]:
        known = [
            one.name for layer in shown if layer.method in methods() for one in methods()[layer.method].makes_passes
        ]
        for name in self._output.passes:
            if name not in known:
                remedy = f"They make: {', '.join(sorted(set(known))) or 'none'}."
                yield fault(("output", "passes"), "No layer of the film makes this pass.", value=name, remedy=remedy)
        if self._output.passes_format not in ("", *PASS_FORMATS):
            yield fault(("output", "passes_format"), "Unknown format of passes.", value=self._output.passes_format,
                        remedy=f"Use one of: {', '.join(PASS_FORMATS)}.")  # fmt: skip

    def _layer(self, layer: Layer, path: Path, video: Asset | None, count: int | None) -> Iterator[DocumentFault]:
        chosen = methods().get(layer.method)
        if chosen is None:
            remedy = f"Use one of: {', '.join(methods())}."
            yield fault((*path, "method"), "Method not found.", value=layer.method, remedy=remedy)
            return
        for wrong in param_faults(chosen, layer.params):
            yield fault_at((*path, *wrong.field.split(".")), wrong)
        for member in ("source", "matte"):
            if (name := getattr(layer, member)) is not None:
                yield from self._check_stored(name, (*path, member))
                yield from self._check_video_input(self._asset(name), (*path, member), video)
        for artefact in self._output.artefacts:
            if artefact not in chosen.artefacts:
                remedy = f"The method {chosen.name!r} makes: {', '.join(chosen.artefacts) or 'none'}."
                yield fault(("output", "artefacts"), "Artefact not found.", value=artefact, remedy=remedy)
        for spec in chosen.inputs:
            if spec.name != "video":
                yield from self._input(chosen, spec, layer, path, video, count)
        for spec, why in missing_inputs(chosen.inputs, {"video", *_given(chosen, layer)}):
            yield fault((*path, "inputs", spec.name), f"{why} {spec.help}", remedy="Give one.")

    def _input(
        self, chosen: Method, spec: InputSpec, layer: Layer, path: Path, video: Asset | None, count: int | None
    ) -> Iterator[DocumentFault]:
        if spec.name in layer.inputs:
            yield from self._file(spec, layer.inputs[spec.name], (*path, "inputs", spec.name))
        elif spec.part and spec.kind == "images":
            yield from self._images(spec, layer, path, video, count)
        elif (value := document_of(chosen, spec, layer)) is not None:
            yield from self._json(chosen, spec, layer, path, value, count)

    def _file(self, spec: InputSpec, name: str, path: Path) -> Iterator[DocumentFault]:
        yield from self._check_stored(name, path)
        asset = self._asset(name)
        if asset is not None and asset.kind not in FITS[spec.kind]:
            yield fault(path, f"This input is {spec.kind}, and the asset is {asset.kind}.", value=asset.id,
                        remedy=f"Use an asset of kind: {', '.join(FITS[spec.kind])}.")  # fmt: skip

    def _images(
        self, spec: InputSpec, layer: Layer, path: Path, video: Asset | None, count: int | None
    ) -> Iterator[DocumentFault]:
        part, _, member = spec.part.partition(".")
        places = {item.frame: index for index, item in enumerate(layer.pictures(part))}
        for frame, name in images_of(layer, spec.part).items():
            at = (*path, "parts", part, places[frame], member)
            yield from self._check_stored(name, at)
            if count is not None and frame >= count:
                remedy = f"Use 0 to {count - 1}."
                yield fault((*at[:-1], "frame"), f"The video has {count} frames.", value=frame, remedy=remedy)
            yield from self._picture(self._asset(name), at, video)

    def _picture(self, asset: Asset | None, path: Path, video: Asset | None) -> Iterator[DocumentFault]:
        if asset is None:
            return
        if asset.kind != "image":
            yield fault(path, f"A drawing is an image, and this asset is {asset.kind}.", value=asset.id,
                        remedy="Upload it as PNG.")  # fmt: skip
        elif video is not None and _size(asset) != _size(video):
            wanted = "x".join(map(str, _size(video)))
            yield fault(path, "Its size differs from the video's.", value="x".join(map(str, _size(asset))),
                        remedy=f"Make it {wanted}.")  # fmt: skip

    def _check_video_input(self, asset: Asset | None, path: Path, video: Asset | None) -> Iterator[DocumentFault]:
        """A video whose frames correspond to those of the shot's video."""
        if asset is None or video is None:
            return
        count, own = self._count(video), self._count(asset)
        if asset.kind not in FITS["video"]:
            yield fault(path, f"This asset is no video: it is {asset.kind}.", value=asset.id,
                        remedy="Name a video, an image or a zip of numbered images.")  # fmt: skip
        elif _size(asset) != _size(video):
            yield fault(path, "Its size differs from the video's.", value="x".join(map(str, _size(asset))),
                        remedy=f"Make it {'x'.join(map(str, _size(video)))}.")  # fmt: skip
        elif count is not None and own is not None and own < count and not (own == 1 and path[-1] == "matte"):
            yield fault(path, f"It has {own} frames, and the video {count}.", value=own,
                        remedy=f"Give it {count} frames.")  # fmt: skip

    def _json(
        self, chosen: Method, spec: InputSpec, layer: Layer, path: Path, value: object, count: int | None
    ) -> Iterator[DocumentFault]:
        check = chosen.input_checks.get(spec.name)
        if check is None:
            return
        masks = any(bool(images_of(layer, other.part)) or other.name in layer.inputs
                    for other in chosen.inputs if other.kind == "images")  # fmt: skip
        for wrong in check(value, frames=count, masks=masks):
            place = (*path, "parts", spec.part, *wrong.path)
            yield fault(place, wrong.message, value=wrong.value, remedy=wrong.remedy)

    def _check_stored(self, name: str, path: Path) -> Iterator[DocumentFault]:
        if self._asset(name) is None:
            yield fault(path, "The asset is not on the server.", value=self._document.assets[name].id,
                        remedy="Upload it again.")  # fmt: skip

    def _asset(self, name: str) -> Asset | None:
        return self._assets.get(self._document.assets[name].id)

    def _count(self, video: Asset | None) -> int | None:
        return None if video is None else int(video.info.get("frames", 0)) or None


def _given(chosen: Method, layer: Layer) -> set[str]:
    """Names of the inputs that a layer has, as files or as parts of the document."""
    images = {spec.name for spec, found in parts_used(chosen, layer) if found}
    documents = {spec.name for spec in chosen.inputs if document_of(chosen, spec, layer) is not None}
    return {*layer.inputs, *images, *documents}


def _size(asset: Asset) -> tuple[int, int]:
    return int(asset.info.get("width", 0)), int(asset.info.get("height", 0))
