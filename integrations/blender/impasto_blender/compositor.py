# SPDX-License-Identifier: GPL-3.0-or-later
"""Painted frames in the compositor."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import bpy

from .work import number_of

NODE = "Impasto"
GAP_PX = 60


def tree_of(scene: bpy.types.Scene) -> bpy.types.NodeTree:
    """The scene's compositing nodes, made if there are none. Blender 5 renders the output of their group."""
    if not hasattr(scene, "compositing_node_group"):
        scene.use_nodes = True
        return scene.node_tree
    if scene.compositing_node_group is None:
        tree = scene.compositing_node_group = bpy.data.node_groups.new("Compositing", "CompositorNodeTree")
        tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
        layers, output = tree.nodes.new("CompositorNodeRLayers"), tree.nodes.new("NodeGroupOutput")
        output.location = (layers.width + GAP_PX, 0)
        tree.links.new(layers.outputs["Image"], output.inputs["Image"])
    return scene.compositing_node_group


def show(scene: bpy.types.Scene, frames: Sequence[Path]) -> bpy.types.Node:
    """Add an Image node with the frames as a sequence, at the frames of their numbers, and a viewer if it has none.

    Nodes and links of the user stay as they are.
    """
    tree = tree_of(scene)
    image = bpy.data.images.load(str(frames[0]), check_existing=False)
    image.source = "SEQUENCE"
    node = tree.nodes.new("CompositorNodeImage")
    node.name = node.label = NODE
    node.image = image
    first = number_of(frames[0])
    node.frame_start, node.frame_duration, node.frame_offset = first, len(frames), first - 1
    node.use_auto_refresh = True
    others = [other for other in tree.nodes if other != node]
    node.location = (0, min((other.location.y - other.height for other in others), default=0) - GAP_PX)
    if not any(other.type == "VIEWER" for other in others):
        viewer = tree.nodes.new("CompositorNodeViewer")
        viewer.location = (node.location.x + node.width + GAP_PX, node.location.y)
        tree.links.new(node.outputs["Image"], viewer.inputs["Image"])
    return node
