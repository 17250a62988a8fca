"""Passes are found by the names that programs give them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from pipeline.formats.base import Choice, PlaneImage
from pipeline.passes.find import Where, depth, find, object_ids
from pipeline.passes.names import Kind
from pipeline.video.passes import picture_choice, settled_choice


def image(names: Sequence[str], views: tuple[str, ...] = (), value: float = 0.5) -> PlaneImage:
    return PlaneImage((3, 2), {name: np.full((2, 3), value, np.float32) for name in names}, views=views)


@pytest.mark.parametrize(("names", "kind", "layer"), [
    (["ViewLayer.IndexOB.X"], "ids", "ViewLayer.IndexOB"),
    (["ViewLayer.Object Index.X"], "ids", "ViewLayer.Object Index"),
    (["ID"], "ids", ""),
    (["VRayObjectID.R"], "ids", "VRayObjectID"),
    (["ViewLayer.Vector.X", "ViewLayer.Vector.Y", "ViewLayer.Vector.Z", "ViewLayer.Vector.W"], "vectors",
     "ViewLayer.Vector"),
    (["forward.u", "forward.v"], "next", "forward"),
    (["motionvector.R", "motionvector.G", "motionvector.B"], "next", "motionvector"),
    (["Motion Vectors.R", "Motion Vectors.G"], "next", "Motion Vectors"),
    (["MV.x", "MV.y"], "next", "MV"),
    (["backward.u", "backward.v"], "previous", "backward"),
    (["N.X", "N.Y", "N.Z"], "normals", "N"),
    (["VRayNormals.R", "VRayNormals.G", "VRayNormals.B"], "normals", "VRayNormals"),
    (["Z"], "depth", ""),
    (["VRayZDepth.R"], "depth", "VRayZDepth"),
    (["depth.Z"], "depth", "depth"),
    (["P.X", "P.Y", "P.Z"], "position", "P"),
    (["ViewLayer.UV.U", "ViewLayer.UV.V", "ViewLayer.UV.A"], "uv", "ViewLayer.UV"),
])  # fmt: skip
def test_names_of_programs(names: list[str], kind: Kind, layer: str) -> None:
    found = find(image(["R", "G", "B", *names]), kind)
    assert found is not None and found.layer == layer and found.programs
    assert picture_choice(image(["R", "G", "B", *names])).colours == ("R", "G", "B")


def test_passes_beside_the_picture_come_first() -> None:
    names = [f"{layer}.{name}" for layer in ("Char", "ViewLayer") for name in ("IndexOB.X", "Depth.Z")]
    found = find(image(names), "ids", Where("ViewLayer.Combined"))
    assert found is not None and found.channels == ("ViewLayer.IndexOB.X",)


def test_passes_of_the_chosen_view() -> None:
    stereo = image(["left.depth.Z", "right.depth.Z"], ("left", "right"))
    left, right = find(stereo, "depth"), find(stereo, "depth", Where(view="right"))
    assert left is not None and right is not None and (left.channels, right.channels) == (
        ("left.depth.Z",), ("right.depth.Z",),
    )  # fmt: skip


@pytest.mark.parametrize("layer", ["Vector", "P", "Custom"])
def test_a_component_of_a_vector_is_no_depth(layer: str) -> None:
    assert depth(image([f"{layer}.{axis}" for axis in "XYZ"])) is None


def test_an_image_without_passes_has_none() -> None:
    assert depth(image(["R", "G", "B"])) is None and object_ids(image(["R", "G", "B"])) is None


def layers(*values: float) -> PlaneImage:
    """View layers A, B, ... with a picture of one value each."""
    planes = {
        f"{name}.Combined.{c}": np.full((2, 3), value, np.float32)
        for name, value in zip("ABC", values, strict=False) for c in "RGB"
    }  # fmt: skip
    return PlaneImage((3, 2), planes)


def test_of_view_layers_the_first_with_a_picture_is_read() -> None:
    choice, notes = settled_choice(Choice(), layers(0, 0.5), lambda: iter([layers(0, 0.5)]))
    assert choice.layer == "B.Combined" and "the first one that is not empty" in notes[0]
    choice, notes = settled_choice(Choice(), layers(0, 0), lambda: iter([layers(0, 0), layers(0.1, 0.5)]))
    assert choice.layer == "A.Combined" and "A.Combined is read." in notes[0]


def test_a_chosen_layer_is_read_even_if_it_is_empty() -> None:
    assert settled_choice(Choice("A"), layers(0, 0.5), lambda: iter([])) == (Choice("A"), ())
