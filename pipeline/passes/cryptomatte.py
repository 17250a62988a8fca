"""Cryptomatte: soft mattes of objects, materials or assets by their names.

An image holds pairs (id, coverage) by rank, two pairs in each RGBA layer. An id is the 32-bit MurmurHash3 of a name,
written as the bits of a float32; the header's manifest lists names with their ids.

Source: Friedman and Jones, "Fully automatic ID mattes with support for motion blur and transparency", SIGGRAPH 2015,
and the Cryptomatte specification 1.2.0.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import BadParameter
from pipeline.formats.base import PlaneImage
from pipeline.frames import Plane
from pipeline.passes.find import ANYWHERE, Where
from pipeline.passes.names import CRYPTOMATTE

PREFIX = "cryptomatte/"
"""Beginning of the names of its attributes in a header."""
_MASK = 0xFFFFFFFF


@dataclass(frozen=True)
class Cryptomatte:
    """One Cryptomatte of an image.

    Attributes:
        layer: its name, such as "ViewLayer.CryptoObject".
        names: id, as an unsigned number, by name; empty: the header has no manifest.
        pairs: full names of the channels (id, coverage) of each rank.
    """

    layer: str
    names: Mapping[str, int]
    pairs: tuple[tuple[str, str], ...]

    def matte(self, image: PlaneImage, *objects: str) -> Plane:
        """Coverage of the named objects together, float32 (h, w), 0..1.

        Raises: BadParameter: the manifest does not have the name.
        """
        wanted = np.array([self._id(name) for name in objects], np.uint32)
        found = np.zeros(image.size[::-1], np.float32)
        for ids, coverage in self.pairs:
            found += np.where(np.isin(_bits(image.planes[ids]), wanted), image.planes[coverage], np.float32(0))
        return np.asarray(np.clip(np.nan_to_num(found), 0, 1), np.float32)

    def labels(self, image: PlaneImage) -> NDArray[np.int32]:
        """Number of the object that covers the most of each pixel, int32 (h, w): its place among the sorted names of
        the manifest, from 1; 0 = none. Without a manifest, the ids themselves are sorted."""
        if not self.pairs:
            return np.zeros(image.size[::-1], np.int32)
        dominant = _bits(image.planes[self.pairs[0][0]])
        dominant = np.where(image.planes[self.pairs[0][1]] > 0, dominant, 0)
        order = [self.names[name] for name in sorted(self.names)] or [int(k) for k in np.unique(dominant) if k]
        numbers = {identity: number for number, identity in enumerate(order, 1)}
        unique, place = np.unique(dominant, return_inverse=True)
        found = np.array([numbers.get(int(one), 0) for one in unique], np.int32)
        return np.asarray(found[place.reshape(dominant.shape)], np.int32)

    def _id(self, name: str) -> int:
        if name in self.names or not self.names:
            return self.names.get(name, object_id(name))
        raise BadParameter("The Cryptomatte has no object of this name.", field="object", value=name,
                           remedy=f"It has: {', '.join(sorted(self.names)[:20])}.")  # fmt: skip


def _bits(plane: Plane) -> NDArray[np.uint32]:
    return np.ascontiguousarray(plane, np.float32).view(np.uint32)


def cryptomattes(image: PlaneImage, where: Where = ANYWHERE) -> list[Cryptomatte]:
    """The Cryptomattes of an image, objects first; those beside the picture come before those of other layers."""
    group = where.picture.rpartition(".")[0]
    manifests = {
        image.attributes[key]: image.attributes.get(key.removesuffix("name") + "manifest", "")
        for key in image.attributes
        if key.startswith(PREFIX) and key.endswith("/name")
    }
    ranks: dict[str, dict[int, dict[str, str]]] = {}
    for full in image.planes:
        stem, _, channel = full.rpartition(".")
        layer, digits = stem[:-2], stem[-2:]
        if CRYPTOMATTE in layer.rpartition(".")[2].lower() and digits.isdigit():
            ranks.setdefault(layer, {}).setdefault(int(digits), {})[channel.lower()] = full
    found = [
        Cryptomatte(layer, _names(_manifest_of(layer, manifests)), _pairs(levels)) for layer, levels in ranks.items()
    ]
    return sorted(found, key=lambda one: (one.layer.rpartition(".")[0] != group, "object" not in one.layer.lower(),
                                          one.layer))  # fmt: skip


def _manifest_of(layer: str, manifests: Mapping[str, str]) -> str:
    """The manifest of a layer; of an image with several parts, the header names the layer without the part."""
    if layer in manifests:
        return manifests[layer]
    return next((text for name, text in manifests.items() if layer.endswith(f".{name}")), "")


def _pairs(levels: Mapping[int, Mapping[str, str]]) -> tuple[tuple[str, str], ...]:
    found = []
    for level in sorted(levels):
        channels = levels[level]
        for ids, coverage in (("r", "g"), ("b", "a"), ("red", "green"), ("blue", "alpha")):
            if ids in channels and coverage in channels:
                found.append((channels[ids], channels[coverage]))
    return tuple(found)


def _names(manifest: str) -> dict[str, int]:
    """Ids by name; {} if the manifest is missing or no JSON object of hexadecimal numbers."""
    try:
        read = json.loads(manifest) if manifest else {}
        return {str(name): int(str(number), 16) & _MASK for name, number in read.items()}
    except (ValueError, AttributeError):
        return {}


def object_id(name: str) -> int:
    """Id of a name, as an unsigned 32-bit number: MurmurHash3 with seed 0, changed where its bits would be no finite
    float32.

    Source: Austin Appleby's MurmurHash3_x86_32.
    """
    hashed = _murmur3(name.encode())
    exponent = hashed >> 23 & 255
    return hashed ^ 1 << 23 if exponent in (0, 255) else hashed


def _murmur3(data: bytes) -> int:
    def mixed(block: int) -> int:
        block = block * 0xCC9E2D51 & _MASK
        return (block << 15 | block >> 17) * 0x1B873593 & _MASK

    found, whole = 0, len(data) // 4 * 4
    for at in range(0, whole, 4):
        found ^= mixed(int.from_bytes(data[at : at + 4], "little"))
        found = ((found << 13 | found >> 19) * 5 + 0xE6546B64) & _MASK
    if whole < len(data):
        found ^= mixed(int.from_bytes(data[whole:], "little"))
    found ^= len(data)
    for shift, factor in ((16, 0x85EBCA6B), (13, 0xC2B2AE35), (16, 1)):
        found = (found ^ found >> shift) * factor & _MASK
    return found
