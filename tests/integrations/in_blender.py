"""Runs in Blender's Python: installs the extension, renders four frames, paints them, and prints what is there as JSON.

python in_blender.py EXTENSION.zip SERVER FOLDER
"""

import json
import sys
from pathlib import Path

import bpy

extension, server, folder = sys.argv[1:4]
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.extensions.package_install_files(filepath=extension, repo="user_default", enable_on_install=True)
(name,) = [each.module for each in bpy.context.preferences.addons if each.module.endswith("impasto_blender")]
bpy.context.preferences.addons[name].preferences.server = server

bpy.ops.mesh.primitive_monkey_add()
monkey = bpy.context.object
bpy.ops.object.light_add(type="SUN", location=(2, -2, 5))
bpy.ops.object.camera_add(location=(0, -5, 0.4), rotation=(1.5, 0, 0))
scene = bpy.context.scene
scene.camera = bpy.context.object
material = bpy.data.materials.new("red")
material.diffuse_color = (0.8, 0.1, 0.05, 1)
monkey.data.materials.append(material)
monkey.pass_index = 3
for frame, x in ((1001, -0.3), (1004, 0.3)):
    monkey.location.x = x
    monkey.keyframe_insert("location", frame=frame)
scene.frame_start, scene.frame_end = 1001, 1004
scene.render.engine, scene.cycles.samples = "CYCLES", 2
scene.render.resolution_x, scene.render.resolution_y = 96, 64
scene.render.image_settings.file_format = "PNG"
bpy.ops.wm.save_as_mainfile(filepath=str(Path(folder) / "shot.blend"))
operators, unwritten = bpy.ops.impasto, "no file"
if bpy.app.version < (5, 0):
    scene.use_nodes = True
    tree = scene.node_tree
else:  # the user's own nodes, at first without an output
    tree = scene.compositing_node_group = bpy.data.node_groups.new("Own", "CompositorNodeTree")
    try:
        operators.render_frames()
    except RuntimeError as error:
        unwritten = str(error)
    tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    layers, output = tree.nodes.new("CompositorNodeRLayers"), tree.nodes.new("NodeGroupOutput")
    tree.links.new(layers.outputs["Image"], output.inputs["Image"])
own = tree.nodes.new("CompositorNodeBlur")
own.name, own.location = "mine", (40, 80)

said = {"connect": list(operators.connect()), "passes": list(operators.switch_on_passes())}
said["rendered"] = list(operators.render_frames())
chosen = scene.impasto
chosen.method, chosen.parameters, chosen.form = "abstraction", "lines=off", "png"
said["checked"] = list(operators.check())
said["painted"] = list(operators.paint())
said["rendered again"] = list(operators.render_frames())

node = tree.nodes["Impasto"]
chosen.parameters = "line=off"
try:
    operators.paint()
    refused = "nothing"
except RuntimeError as error:
    refused = str(error)
if bpy.app.version >= (5, 0):  # without nodes of the user's, rendering continues with those of the extension
    scene.compositing_node_group, chosen.parameters = None, "lines=off"
    said["painted without nodes"] = list(operators.paint())
    said["rendered with its nodes"] = list(operators.render_frames())
print("RESULT " + json.dumps({
    "said": said, "passes": [bool(getattr(bpy.context.view_layer, p)) for p in
                             ("use_pass_vector", "use_pass_object_index", "use_pass_z", "use_pass_normal")],
    "format": scene.render.image_settings.file_format,
    "node": [node.frame_start, node.frame_duration, node.frame_offset, list(node.image.size), node.image.source],
    "mine": list(tree.nodes["mine"].location),
    "viewer": [n.type for n in tree.nodes].count("VIEWER"),
    "files": sorted(str(p.relative_to(folder)) for p in Path(folder).rglob("*") if p.is_file()),
    "refused": refused, "unwritten": unwritten,
}))  # fmt: skip
bpy.ops.preferences.addon_disable(module=name)
