"""Previews of one stylised frame of a job that is not submitted, for a page on which a user moves a slider."""

from __future__ import annotations

import zipfile
from collections.abc import Container, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field

from pipeline.arrays import AnyArray
from pipeline.errors import BadParameter
from pipeline.methods import method
from pipeline.methods.base import Method
from pipeline.video.guard.files import GuardedImages
from pipeline.video.stills import encode_png
from workers.blobs.base import Blobs
from workers.contract.record import Asset, asset_key
from workers.contract.request import JobRequest, Json
from workers.previews.memory import Check
from workers.previews.model import LayerSources, video_key
from workers.previews.painting import LayerPainter
from workers.previews.warm import WarmFrames


@dataclass(frozen=True)
class PreviewAsk:
    """The frame to preview, and replacements of the request's inputs.

    Attributes:
        frame: number of the frame; the last one of a shorter video.
        max_side_px: longest side of the result; frames are never enlarged.
        documents: JSON documents that replace the inputs of these names.
        artefacts: artefacts of an earlier job: name -> blob key of a zip.
    """

    frame: int
    max_side_px: int
    documents: Mapping[str, Json] = field(default_factory=dict)
    artefacts: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class PreviewJob:
    """A job that is not submitted, and what to show of it.

    Attributes:
        assets: input name -> asset.
    """

    request: JobRequest
    assets: Mapping[str, Asset]
    ask: PreviewAsk


def frame_png(job: PreviewJob, frames: WarmFrames, blobs: Blobs, check: Check) -> bytes:
    """A frame of the request's video, stylised by its method as a layer of a project is, as PNG.

    Raises: BadParameter (parameters, a design, painted keyframes), BadMedia.
    """
    chosen, ask = method(job.request.method), job.ask
    keys = {name: asset_key(asset.id) for name, asset in job.assets.items()}
    _refuse_what_has_no_effect(chosen, keys, {**ask.documents, **ask.artefacts})
    kinds = {spec.name: spec.kind for spec in chosen.inputs}
    with ExitStack() as exit_stack:
        archives = {
            name: _images(exit_stack, blobs, key, name) for name, key in keys.items() if kinds[name] == "images"
        }
        artefacts = {name: _entries(exit_stack, blobs, key) for name, key in ask.artefacts.items()}
        layer = LayerSources(
            "", chosen.name, job.request.params, job.request.seed, video_key(keys.pop("video"), job.request.source),
            {name: key for name, key in keys.items() if name not in archives}, documents=ask.documents,
        )  # fmt: skip
        painter = LayerPainter(layer, frames, check, artefacts, archives)
        return encode_png(painter.draft(max(ask.frame, 0), ask.max_side_px))


def _refuse_what_has_no_effect(chosen: Method, given: Container[str], replacements: Mapping[str, object]) -> None:
    for spec in chosen.inputs:
        if spec.name in given and not spec.preview:
            raise BadParameter(
                f"The input {spec.name!r} has no effect on a preview of one frame.", field=f"inputs.{spec.name}",
                remedy="Render a few seconds, or preview without it.",
            )  # fmt: skip
    if replacements and type(chosen).preview is Method.preview:
        name = next(iter(replacements))
        raise BadParameter(f"The method {chosen.name!r} takes no {name}.", field=name, remedy="Leave it out.")


def _images(exit_stack: ExitStack, blobs: Blobs, key: str, name: str) -> Mapping[int, AnyArray]:
    guarded = GuardedImages(exit_stack.enter_context(blobs.local(key)), f"inputs.{name}")
    exit_stack.callback(guarded.close)
    return guarded


def _entries(exit_stack: ExitStack, blobs: Blobs, key: str) -> Mapping[str, bytes]:
    return ZipEntries(exit_stack.enter_context(zipfile.ZipFile(exit_stack.enter_context(blobs.local(key)))))


class ZipEntries(Mapping[str, bytes]):
    """The entries of an open zip archive by path, each read on access."""

    def __init__(self, archive: zipfile.ZipFile) -> None:
        self._archive = archive

    def __getitem__(self, name: str) -> bytes:
        return self._archive.read(name)

    def __iter__(self) -> Iterator[str]:
        return iter(self._archive.namelist())

    def __len__(self) -> int:
        return len(self._archive.namelist())
