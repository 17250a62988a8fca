# SPDX-License-Identifier: GPL-3.0-or-later
"""Impasto in Blender: paints rendered frames on a service and loads them into the compositor."""

from __future__ import annotations

import bpy

from .operators import CLASSES, current
from .settings import METHODS, Input, Preferences, Settings


class Panel(bpy.types.Panel):
    bl_label = "Impasto"
    bl_idname = "RENDER_PT_impasto"
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "output"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout, chosen = self.layout, context.scene.impasto
        layout.use_property_split = True
        layout.operator("impasto.connect", icon="WORLD")
        frames = layout.column()
        frames.prop(chosen, "frames_from", expand=True)
        if chosen.frames_from == "FOLDER":
            frames.prop(chosen, "rendered")
        else:
            frames.operator("impasto.switch_on_passes")
            frames.operator("impasto.render_frames", icon="RENDER_ANIMATION")
        look = layout.column()
        look.enabled = bool(METHODS)
        for name in ("method", "preset", "parameters", "seed"):
            look.prop(chosen, name)
        for index, given in enumerate(chosen.inputs):
            row = look.row(align=True)
            row.prop(given, "input", text="")
            row.prop(given, "where", text="")
            row.operator("impasto.remove_input", text="", icon="X").index = index
        look.operator("impasto.add_input", icon="ADD")
        layout.prop(chosen, "folder")
        layout.prop(chosen, "form", expand=True)
        row = layout.row()
        row.operator("impasto.check")
        row.operator("impasto.paint", icon="BRUSH_DATA")
        if current:
            self._progress(layout, current[-1])

    def _progress(self, layout: bpy.types.UILayout, painting: object) -> None:
        if painting.running:
            layout.progress(factor=painting.progress, text=painting.said)
            layout.operator("impasto.cancel", icon="CANCEL")
        else:
            layout.label(text=painting.error or painting.said, icon="ERROR" if painting.error else "INFO")


_CLASSES = (Preferences, Input, Settings, *CLASSES, Panel)


def register() -> None:
    for each in _CLASSES:
        bpy.utils.register_class(each)
    bpy.types.Scene.impasto = bpy.props.PointerProperty(type=Settings)


def unregister() -> None:
    for painting in current:
        painting.cancel()
    del bpy.types.Scene.impasto
    for each in reversed(_CLASSES):
        bpy.utils.unregister_class(each)
