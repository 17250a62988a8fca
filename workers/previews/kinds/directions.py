"""Stroke directions of a frame with the present design, which the page draws."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pipeline.errors import BadParameter
from pipeline.methods import methods
from workers.previews.context import PreviewContext
from workers.previews.kinds.regions import known_artefacts
from workers.previews.model import Record
from workers.previews.painting import LayerPainter


def directions(context: PreviewContext) -> Iterator[Record]:
    """Angle and strength on a grid of points `spacing_px` apart, float32 little-endian, rows x columns x 2."""
    layer, number, spacing = context.query.layers[0], context.options["frame"], context.options["spacing_px"]
    painter = LayerPainter(layer, context.frames, context.check, known_artefacts(context, layer))
    field, (width, height) = painter.directions(number, context.query.side_px)
    if field is None:
        able = ", ".join(name for name, known in methods().items() if "directions" in known.preview_kinds()) or "none"
        raise BadParameter(f"The method {layer.method!r} has no stroke directions.", field="layer", value=layer.id,
                           remedy=f"Choose a method that has: {able}.")  # fmt: skip
    columns, rows = max(1, width // spacing), max(1, height // spacing)
    x = ((np.arange(columns) + 0.5) * field.shape[1] / columns).astype(np.intp)
    y = ((np.arange(rows) + 0.5) * field.shape[0] / rows).astype(np.intp)
    header = {"type": "field", "frame": number, "columns": columns, "rows": rows, "spacing_px": spacing,
              "width": width, "height": height, "dtype": "float32", "order": "angle,strength"}  # fmt: skip
    yield Record(header, np.ascontiguousarray(field[np.ix_(y, x)], "<f4").tobytes())
