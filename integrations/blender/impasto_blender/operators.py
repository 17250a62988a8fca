# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators: the actions of the buttons in the panel."""

from __future__ import annotations

import time
from pathlib import Path

import bpy

from impasto_client import Client, ImpastoError

from . import compositor, passes
from .settings import METHODS, order_of, preferences
from .work import Painting, check

TICK_S = 0.2
CLOCK_S = 2.0
"""Difference between the clocks of this computer and of a file server, and precision of file times, seconds."""
current: list[Painting] = []
"""The painting that runs or ran last; at most one."""


class Connect(bpy.types.Operator):
    """Ask the service for its methods"""

    bl_idname = "impasto.connect"
    bl_label = "Connect"

    def execute(self, context: bpy.types.Context) -> set[str]:
        service = preferences()
        try:
            with Client(service.server, service.api_key, ca_file=service.ca_file) as client:
                found = client.methods()
        except ImpastoError as error:
            return failed(self, error)
        METHODS.clear()
        METHODS.update({method["name"]: method for method in found})
        self.report({"INFO"}, f"{len(METHODS)} methods")
        return {"FINISHED"}


class SwitchOnPasses(bpy.types.Operator):
    """Switch on the passes that Impasto uses: motion vectors, object ids, Cryptomatte, depth, normals"""

    bl_idname = "impasto.switch_on_passes"
    bl_label = "Switch On Passes"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        changed = passes.switch_on(context.scene, context.view_layer)
        self.report({"INFO"}, f"Changed: {', '.join(changed)}" if changed else "All passes are on already")
        return {"FINISHED"}


class AddInput(bpy.types.Operator):
    """Add an input of the method, such as a style painting or keys"""

    bl_idname = "impasto.add_input"
    bl_label = "Add Input"
    bl_options = {"UNDO"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        context.scene.impasto.inputs.add()
        return {"FINISHED"}


class RemoveInput(bpy.types.Operator):
    """Remove this input"""

    bl_idname = "impasto.remove_input"
    bl_label = "Remove Input"
    bl_options = {"UNDO"}

    index: bpy.props.IntProperty()

    def execute(self, context: bpy.types.Context) -> set[str]:
        context.scene.impasto.inputs.remove(self.index)
        return {"FINISHED"}


class RenderFrames(bpy.types.Operator):
    """Render the frame range as multilayer EXR files for Impasto"""

    bl_idname = "impasto.render_frames"
    bl_label = "Render Frames"

    def execute(self, context: bpy.types.Context) -> set[str]:
        frames = rendered_folder(context.scene)
        frames.mkdir(parents=True, exist_ok=True)
        started, scene = time.time(), context.scene
        with passes.multilayer(scene, str(frames / "frame.####")):
            bpy.ops.render.render(animation=True, scene=scene.name)
            numbers = range(scene.frame_start, scene.frame_end + 1, scene.frame_step)
            files = [Path(scene.render.frame_path(frame=number)) for number in numbers]
        if missing := [file for file in files if not file.exists() or file.stat().st_mtime < started - CLOCK_S]:
            self.report({"ERROR"}, f"Blender wrote no file {missing[0].name}. Do the compositing nodes have an output?")
            return {"CANCELLED"}
        self.report({"INFO"}, f"Frames are in {frames}")
        return {"FINISHED"}


class Check(bpy.types.Operator):
    """Send the frames and ask the service what painting them would take"""

    bl_idname = "impasto.check"
    bl_label = "Check"

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            self.report({"INFO"}, check(order_of(context.scene, rendered_folder(context.scene))))
        except (ImpastoError, OSError) as error:
            return failed(self, error)
        return {"FINISHED"}


class Paint(bpy.types.Operator):
    """Send the rendered frames, paint them, and load the result into the compositor"""

    bl_idname = "impasto.paint"
    bl_label = "Paint"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return not (current and current[-1].running)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        try:
            self._begin(context)
        except (ImpastoError, OSError) as error:
            return failed(self, error)
        self._timer = context.window_manager.event_timer_add(TICK_S, window=context.window)
        context.window_manager.progress_begin(0, 100)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        context.window_manager.progress_update(100 * current[-1].progress)
        for area in context.screen.areas:
            area.tag_redraw()
        if current[-1].running:
            return {"PASS_THROUGH"}
        context.window_manager.event_timer_remove(self._timer)
        context.window_manager.progress_end()
        return self._end(context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Called by a script: paint, and return when the frames are painted."""
        try:
            self._begin(context)
        except (ImpastoError, OSError) as error:
            return failed(self, error)
        while current[-1].running:
            current[-1].wait(TICK_S)
        return self._end(context)

    def _begin(self, context: bpy.types.Context) -> None:
        order = order_of(context.scene, rendered_folder(context.scene))
        self._scene = context.scene.name
        current[:] = [Painting(order).start()]

    def _end(self, context: bpy.types.Context) -> set[str]:
        painting = current[-1]
        for warning in painting.warnings:
            self.report({"WARNING"}, warning)
        if painting.error:
            self.report({"ERROR"}, painting.error)
            return {"CANCELLED"}
        if not painting.painted:
            return {"CANCELLED"}
        compositor.show(bpy.data.scenes[self._scene], painting.painted)
        self.report({"INFO"}, f"{len(painting.painted)} frames are in {painting.order.folder}")
        return {"FINISHED"}


class Cancel(bpy.types.Operator):
    """Cancel the painting; files that exist stay as they are"""

    bl_idname = "impasto.cancel"
    bl_label = "Cancel"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return bool(current) and current[-1].running

    def execute(self, context: bpy.types.Context) -> set[str]:
        current[-1].cancel()
        return {"FINISHED"}


def rendered_folder(scene: bpy.types.Scene) -> Path:
    """The folder of the frames: the user's, or the one into which `RenderFrames` renders."""
    chosen = scene.impasto
    if chosen.frames_from == "FOLDER":
        return Path(bpy.path.abspath(chosen.rendered))
    return Path(bpy.path.abspath(chosen.folder)) / "rendered"


def failed(operator: bpy.types.Operator, error: Exception) -> set[str]:
    """Show an error's sentence: field, value and remedy."""
    operator.report({"ERROR"}, str(error))
    return {"CANCELLED"}


CLASSES = (Connect, SwitchOnPasses, AddInput, RemoveInput, RenderFrames, Check, Paint, Cancel)
