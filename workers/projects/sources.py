"""The inputs of a layer for a preview: blob keys and documents, without uploads."""

from __future__ import annotations

from collections.abc import Mapping

from pipeline.methods import methods
from workers.contract.record import Asset, asset_key
from workers.contract.request import Json
from workers.errors import NotFound
from workers.previews.model import LayerSources, video_key
from workers.projects.document import Document, Layer, Shot
from workers.projects.submissions import document_of, parts_used


def layer_sources(document: Document, shot: Shot, layer: Layer, assets: Mapping[str, Asset]) -> LayerSources:
    """The layer's sources. Frame numbers are those of the whole video.

    Args:
        assets: id -> asset, for those that the project's owner has. Raises NotFound for any other.
    """
    chosen = methods()[layer.method]

    def key(name: str) -> str:
        asset_id = document.assets[name].id
        if asset_id not in assets:
            raise NotFound("The asset is not on the server.", field="asset", value=asset_id, remedy="Upload it again.")
        return asset_key(asset_id)

    names = {spec.name for spec in chosen.inputs}
    documents: Json = {}
    for spec in chosen.inputs:
        if spec.name not in layer.inputs and (value := document_of(chosen, spec, layer)) is not None:
            documents[spec.name] = value
    images = {spec.name: {frame: key(name) for frame, name in found.items()}
              for spec, found in parts_used(chosen, layer) if found}  # fmt: skip
    return LayerSources(
        id=layer.id,
        method=layer.method,
        params=dict(layer.params),
        seed=layer.seed,
        video=key(layer.source) if layer.source else video_key(key(shot.video), shot.source.options()),
        files={name: key(asset) for name, asset in layer.inputs.items() if name in names and name != "video"},
        images=images,
        documents=documents,
        opacity=layer.opacity,
        blend=layer.blend,
        matte=None if layer.matte is None else key(layer.matte),
        below=video_key(key(shot.video), shot.source.options()),
    )
