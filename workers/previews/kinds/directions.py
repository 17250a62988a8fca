"""Stroke directions of a frame with the present design, which the page draws."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import BadParameter
from pipeline.methods import methods
from workers.previews.context import PreviewContext
from workers.previews.kinds.paint import DRAFT_FROM_PIXELS
from workers.previews.kinds.regions import known_artefacts, layer_film
from workers.previews.model import Record
from workers.previews.painting import LayerPainter


def directions(context: PreviewContext) -> Iterator[Record]:
    """Angle and strength on a grid of points `spacing_px` apart, float32 little-endian, rows x columns x 2: those of
    the film, which are `final`; before them those of the frame alone, if the film takes long."""
    layer, number, side = context.query.layers[0], context.options["frame"], context.query.side_px
    film = layer_film(context, layer, side)
    draft = film.pixels >= DRAFT_FROM_PIXELS
    if draft:
        yield _record(context, number, _draft(context, number), final=False)
        context.check()
    found = film.plane("directions", number, context.check)
    if found is not None:
        yield _record(context, number, found.plane, final=True, moved=found.moved)
    elif not draft:
        yield _record(context, number, _draft(context, number), final=False)


def _draft(context: PreviewContext, number: int) -> NDArray[np.float32]:
    layer = context.query.layers[0]
    painter = LayerPainter(layer, context.frames, context.check, known_artefacts(context, layer))
    field = painter.directions(number, context.query.side_px)
    if field is None:
        able = ", ".join(name for name, known in methods().items() if "directions" in known.preview_kinds()) or "none"
        raise BadParameter(f"The method {layer.method!r} has no stroke directions.", field="layer", value=layer.id,
                           remedy=f"Choose a method that has: {able}.")  # fmt: skip
    return field


def _record(context: PreviewContext, number: int, field: NDArray[np.float32], *, final: bool, **more: object) -> Record:
    info, spacing = context.frames.info(context.query.layers[0].video), context.options["spacing_px"]
    scale = min(1.0, context.query.side_px / max(info.width, info.height))
    width, height = (max(1, round(side * scale)) for side in (info.width, info.height))
    columns, rows = max(1, width // spacing), max(1, height // spacing)
    x = ((np.arange(columns) + 0.5) * field.shape[1] / columns).astype(np.intp)
    y = ((np.arange(rows) + 0.5) * field.shape[0] / rows).astype(np.intp)
    header = {"type": "field", "frame": number, "columns": columns, "rows": rows, "spacing_px": spacing,
              "width": width, "height": height, "dtype": "float32", "order": "angle,strength",
              "final": final, **more}  # fmt: skip
    return Record(header, np.ascontiguousarray(field[np.ix_(y, x)], "<f4").tobytes())
