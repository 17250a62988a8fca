"""Names of a layer's inputs, tasks and artefacts within the job of all layers."""

from __future__ import annotations

VIDEO, MATTE = "video", "matte"
COMPOSITE = "composite"


def stage(index: int) -> str:
    """Step of the job in which every layer's step `index` runs."""
    return f"layers-{index + 1}"


def input_name(layer: int, name: str) -> str:
    """Input of the job that is the layer's input `name`; "matte" is the layer's own, "video" another video for it."""
    return f"layer{layer}.{name}"


def prefix(layer: int) -> str:
    """Beginning of the keys of the layer's tasks, and of the names of its artefacts and files."""
    return f"layer{layer}-"
