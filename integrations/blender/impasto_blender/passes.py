# SPDX-License-Identifier: GPL-3.0-or-later
"""The passes that Impasto reads, and the file format that holds them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import bpy

PASSES = {
    "use_pass_vector": "Vector", "use_pass_object_index": "Object Index", "use_pass_z": "Depth",
    "use_pass_normal": "Normal", "use_pass_cryptomatte_object": "Cryptomatte Object",
}  # fmt: skip
"""Property of a view layer -> what Blender calls it."""
NOT_IN_EEVEE = "use_pass_object_index"


def switch_on(scene: bpy.types.Scene, layer: bpy.types.ViewLayer) -> list[str]:
    """Switch the passes on; returns what was changed, as Blender names it."""
    changed = []
    for name, title in PASSES.items():
        available = hasattr(layer, name) and not (name == NOT_IN_EEVEE and "EEVEE" in scene.render.engine)
        if available and not getattr(layer, name):
            setattr(layer, name, True)
            changed.append(title)
    if scene.render.use_motion_blur and layer.use_pass_vector and scene.render.engine == "CYCLES":
        scene.render.use_motion_blur = False  # Cycles writes no vectors with motion blur
        changed.append("Motion Blur (off: Cycles writes no vectors with it)")
    return changed


@contextmanager
def multilayer(scene: bpy.types.Scene, path: str) -> Iterator[None]:
    """Within this context, the scene renders multilayer EXR files to `path`; afterwards, as before."""
    render = scene.render
    kept: list[tuple[Any, str, Any]] = [(render, name, getattr(render, name)) for name in ("filepath", "use_overwrite")]
    settings = render.image_settings
    names = [name for name in ("media_type", "file_format", "color_depth", "exr_codec") if hasattr(settings, name)]
    kept += [(settings, name, getattr(settings, name)) for name in names]
    try:
        render.filepath, render.use_overwrite = path, True
        if hasattr(settings, "media_type"):  # Blender 5
            settings.media_type = "MULTI_LAYER_IMAGE"
        settings.file_format = "OPEN_EXR_MULTILAYER"
        settings.color_depth, settings.exr_codec = "16", "ZIP"
        yield
    finally:
        for owner, name, value in kept:
            setattr(owner, name, value)
