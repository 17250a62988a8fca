"""Cryptomatte: ids of names, soft mattes, and labels."""

from __future__ import annotations

import json

import numpy as np
import pytest

from pipeline.errors import BadParameter
from pipeline.formats.base import PlaneImage
from pipeline.passes.cryptomatte import cryptomattes, object_id
from pipeline.passes.find import Where

BLENDER = {"Ground": 0x24950135, "Cube": 0xA8FCE865, "Sphere": 0xE5E9B0DB, "Sun": 0xEE8D1AE3}
"""Ids in the header of a file of Blender 4.5."""


def as_float(name: str) -> np.float32:
    return np.frombuffer(np.uint32(object_id(name)).tobytes(), np.float32)[0]


def image(manifest: bool = True, layer: str = "ViewLayer.CryptoObject") -> PlaneImage:
    """Left: cube; middle: 0.75 cube, 0.25 sphere; right: nothing."""
    cube, sphere = as_float("Cube"), as_float("Sphere")
    planes = {"r": [cube, cube, 0], "g": [1, 0.75, 0], "b": [0, sphere, 0], "a": [0, 0.25, 0]}
    text = {"Cube": f"{object_id('Cube'):08x}", "Sphere": f"{object_id('Sphere'):08x}"}
    header = {"cryptomatte/1234567/name": layer}
    if manifest:
        header["cryptomatte/1234567/manifest"] = json.dumps(text)
    named = {f"{layer}00.{channel}": np.array([values], np.float32) for channel, values in planes.items()}
    return PlaneImage((3, 1), named, attributes=header)


@pytest.mark.parametrize(("name", "expected"), BLENDER.items())
def test_ids_are_those_of_blender(name: str, expected: int) -> None:
    assert object_id(name) == expected


def test_an_id_is_a_finite_number() -> None:
    names = [f"object{k}" for k in range(20_000)]
    bits = np.array([object_id(name) for name in names], np.uint32)
    assert np.isfinite(bits.view(np.float32)).all() and not np.isin(bits >> 23 & 255, (0, 255)).any()


@pytest.mark.parametrize("manifest", [True, False])
def test_mattes_are_soft_and_add_up(manifest: bool) -> None:
    here = image(manifest)
    (found,) = cryptomattes(here)
    np.testing.assert_array_equal(found.matte(here, "Cube"), [[1, 0.75, 0]])
    np.testing.assert_array_equal(found.matte(here, "Sphere"), [[0, 0.25, 0]])
    np.testing.assert_array_equal(found.matte(here, "Sphere", "Cube"), [[1, 1, 0]])
    assert found.labels(here).tolist() == [[1, 1, 0]]


def test_an_unknown_name_is_refused_with_the_known_ones() -> None:
    (found,) = cryptomattes(image())
    with pytest.raises(BadParameter) as raised:
        found.matte(image(), "Cubb")
    assert raised.value.value == "Cubb" and "Cube, Sphere" in str(raised.value.remedy)


def test_the_cryptomatte_beside_the_picture_comes_first() -> None:
    one, other = image(layer="Char.CryptoObject"), image(layer="ViewLayer.CryptoObject")
    both = PlaneImage((3, 1), {**one.planes, **other.planes})
    assert cryptomattes(both, Where("ViewLayer.Combined"))[0].layer == "ViewLayer.CryptoObject"
