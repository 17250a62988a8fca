"""The pass of a kind in an image with planes, by the names of its layers and channels."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.formats.base import PlaneImage
from pipeline.frames import Plane
from pipeline.passes.names import CHANNELS, PASS_NAMES, Kind, PassName, is_pass, plain


@dataclass(frozen=True)
class Where:
    """Where passes are looked for, if several layers or views have them.

    Attributes:
        picture: layer of the picture, such as "ViewLayer.Combined": passes beside it come first.
        view: name of the view; "" = the first one.
    """

    picture: str = ""
    view: str = ""


ANYWHERE = Where()


@dataclass(frozen=True)
class FoundPass:
    """A pass of an image: its layer, the programs that name it so, and the full names of its channels."""

    layer: str
    programs: str
    channels: tuple[str, ...]

    def planes(self, image: PlaneImage) -> NDArray[np.float32]:
        """Its channels, float32 (h, w, n)."""
        return np.stack([image.planes[name] for name in self.channels], -1)


def layer_and_view(stem: str, views: tuple[str, ...]) -> tuple[str, str]:
    """Layer and view of a channel's name without its last component; a name without a view is of the first one."""
    parts = stem.split(".") if stem else []
    view = next((part for part in parts if part in views), views[0] if views else "")
    own = [_without(part, views) for part in parts if part not in views]
    return ".".join(part for part in own if part), view


def _without(part: str, views: tuple[str, ...]) -> str:
    """A component without the view at its end: "rgba_left" is "rgba"."""
    view = next((view for view in views if part.endswith(("_" + view, "-" + view, " " + view))), "")
    return part[: -len(view) - 1] if view else part


def layers_of(image: PlaneImage) -> dict[tuple[str, str], dict[str, str]]:
    """(layer, view) -> channel name in lower case -> full name."""
    found: dict[tuple[str, str], dict[str, str]] = {}
    for full in image.planes:
        stem, _, last = full.rpartition(".")
        found.setdefault(layer_and_view(stem, image.views), {})[last.lower()] = full
    return found


def find(image: PlaneImage, kind: Kind, where: Where = ANYWHERE) -> FoundPass | None:
    """The pass of a kind; None: the image has none."""
    view = where.view or (image.views[0] if image.views else "")
    layers = {layer: channels for (layer, of), channels in layers_of(image).items() if of == view}
    group = where.picture.rpartition(".")[0]
    order = sorted(layers, key=lambda layer: (layer.rpartition(".")[0] != group, layer))
    rows = [row for row in PASS_NAMES if row.kind == kind]
    for name, row in ((name, one) for one in rows for name in one.names):
        for layer in order:
            if channels := _channels(layer, layers[layer], name, row):
                return FoundPass(layer, row.programs, channels)
    return None


def _channels(layer: str, channels: Mapping[str, str], name: str, row: PassName) -> tuple[str, ...]:
    """Full names of the channels of a layer if it is the pass; () = it is another one."""
    if plain(layer.rpartition(".")[2]) == name:
        wanted = next((c for c in CHANNELS[row.kind] if all(one in channels for one in c)), ())
        return tuple(channels[one] for one in wanted)
    if len(CHANNELS[row.kind][0]) > 1 or is_pass(layer) or {"x", "y"} <= channels.keys():
        return ()  # the Z of a vector is no depth
    return next(((full,) for channel, full in channels.items() if plain(channel) == name), ())  # "Z", "ID" alone


def described(image: PlaneImage, where: Where = ANYWHERE) -> Iterator[tuple[Kind, FoundPass]]:
    """All known passes of an image."""
    for kind in CHANNELS:
        if (found := find(image, kind, where)) is not None:
            yield kind, found


# -- planes of passes


def normals(image: PlaneImage, where: Where = ANYWHERE) -> NDArray[np.float32] | None:
    """The normal pass, float32 (h, w, 3); None if there is no such pass."""
    return _planes(image, "normals", where)


def position(image: PlaneImage, where: Where = ANYWHERE) -> NDArray[np.float32] | None:
    """Positions in space, float32 (h, w, 3), in the renderer's unit; None if there is no such pass."""
    return _planes(image, "position", where)


def uv(image: PlaneImage, where: Where = ANYWHERE) -> NDArray[np.float32] | None:
    """Texture coordinates, float32 (h, w, 2); None if there is no such pass."""
    return _planes(image, "uv", where)


def depth(image: PlaneImage, where: Where = ANYWHERE) -> Plane | None:
    """The depth pass, float32 (h, w), in the renderer's unit; None if there is no such pass."""
    found = _planes(image, "depth", where)
    return None if found is None else np.ascontiguousarray(found[..., 0])


def object_ids(image: PlaneImage, where: Where = ANYWHERE) -> NDArray[np.int32] | None:
    """The object index pass, int32 (h, w); None if there is no such pass."""
    found = _planes(image, "ids", where)
    return None if found is None else np.rint(np.nan_to_num(found[..., 0])).astype(np.int32)


def _planes(image: PlaneImage, kind: Kind, where: Where) -> NDArray[np.float32] | None:
    found = find(image, kind, where)
    return None if found is None else found.planes(image)
