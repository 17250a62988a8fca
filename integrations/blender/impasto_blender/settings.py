# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings of the user. The service is in the preferences; the rest is in the scene, and saved in the .blend file."""

from __future__ import annotations

from pathlib import Path

import bpy

from .work import Order, parsed_params, rendered, unused_folder

PACKAGE = __package__
SERVICE_DEFAULT = "http://127.0.0.1:8420"
METHODS: dict[str, dict] = {}
"""Methods of the service, by name; filled by the operator that connects."""
_NONE = [("NONE", "Not connected", "Connect to the service first")]
_items: dict[str, list[tuple[str, str, str]]] = {}
"""Blender keeps no reference to the texts of a list that a function makes."""


def _methods(settings: Settings, context: object) -> list[tuple[str, str, str]]:
    _items["methods"] = [(name, m["title"], m["summary"]) for name, m in METHODS.items()] or _NONE
    return _items["methods"]


def _presets(settings: Settings, context: object) -> list[tuple[str, str, str]]:
    examples = METHODS.get(settings.method, {}).get("examples", ())
    usual = [("DEFAULT", "Default", "The method's own settings")]
    _items["presets"] = usual + [(e["name"], e["title"], "") for e in examples]
    return _items["presets"]


def _inputs(given: Input, context: bpy.types.Context) -> list[tuple[str, str, str]]:
    found = METHODS.get(context.scene.impasto.method, {}).get("inputs", ())
    _items["inputs"] = [(i["name"], i["title"], i["help"]) for i in found if i["name"] != "video"] or _NONE
    return _items["inputs"]


class Preferences(bpy.types.AddonPreferences):
    bl_idname = PACKAGE

    server: bpy.props.StringProperty(name="Service", default=SERVICE_DEFAULT, description="Address of the service")
    api_key: bpy.props.StringProperty(name="API key", subtype="PASSWORD", description="Empty: the service is open")
    ca_file: bpy.props.StringProperty(
        name="Certificates", subtype="FILE_PATH", description="PEM file of your network's authorities; empty: the usual"
    )

    def draw(self, context: bpy.types.Context) -> None:
        self.layout.prop(self, "server")
        self.layout.prop(self, "api_key")
        self.layout.prop(self, "ca_file")


class Input(bpy.types.PropertyGroup):
    """A file, a folder of pictures, or an asset of the service, for an input of the method."""

    input: bpy.props.EnumProperty(name="Input", items=_inputs)
    where: bpy.props.StringProperty(
        name="File", subtype="FILE_PATH", description="A file, a folder of pictures (keys), or an asset id (ast_...)"
    )


class Settings(bpy.types.PropertyGroup):
    frames_from: bpy.props.EnumProperty(
        name="Frames", items=[
            ("RENDER", "Render", "Render the scene's frame range as multilayer EXR files"),
            ("FOLDER", "Rendered", "Take pictures that are there already"),
        ],
    )  # fmt: skip
    rendered: bpy.props.StringProperty(name="Folder", subtype="DIR_PATH", description="Pictures with frame numbers")
    folder: bpy.props.StringProperty(
        name="Output", subtype="DIR_PATH", default="//impasto/", description="Folder of the painted frames"
    )
    form: bpy.props.EnumProperty(
        name="Format", items=[("png", "PNG", "8 bit, sRGB"), ("exr", "OpenEXR", "Half float, linear Rec. 709")]
    )
    method: bpy.props.EnumProperty(name="Method", items=_methods)
    preset: bpy.props.EnumProperty(name="Preset", items=_presets)
    parameters: bpy.props.StringProperty(name="Parameters", description="name=value, with spaces between")
    seed: bpy.props.IntProperty(name="Seed", min=0)
    inputs: bpy.props.CollectionProperty(type=Input)


def preferences() -> Preferences:
    return bpy.context.preferences.addons[PACKAGE].preferences


def order_of(scene: bpy.types.Scene, frames: Path) -> Order:
    """The order for the pictures of a folder. Raises: BadInput, BadParameter."""
    chosen, service, settings = scene.impasto, preferences(), scene.render
    examples = {e["name"]: e["params"] for e in METHODS.get(chosen.method, {}).get("examples", ())}
    params = {**examples.get(chosen.preset, {}), **parsed_params(chosen.parameters)}
    inputs = {given.input: _path(given.where) for given in chosen.inputs if given.where}
    folder = unused_folder(Path(bpy.path.abspath(chosen.folder)))
    pictures = rendered(frames) if frames.is_dir() else ()
    return Order(
        service.server, service.api_key, pictures, settings.fps / settings.fps_base, chosen.method, params,
        inputs, folder, chosen.form, chosen.seed, service.ca_file,
    )  # fmt: skip


def _path(where: str) -> str:
    return where if where.startswith("ast_") else bpy.path.abspath(where)
