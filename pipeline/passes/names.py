"""Names under which programs write render passes into image files, as one table.

A pass is recognised by the last component of its layer's name, in lower case and without spaces and punctuation
("ViewLayer.Object Index.X": "objectindex"), and by the names of its channels. A new program is a row here.
"""

from __future__ import annotations

import re
from typing import Literal, NamedTuple

Kind = Literal["vectors", "next", "previous", "normals", "ids", "depth", "position", "uv"]
"""Kinds of passes. "vectors": four channels, of which the first two belong to the previous frame and the last two to
the next one. "next" and "previous": two channels."""

_PAIR = (("x", "y"), ("u", "v"), ("r", "g"))
_TRIPLE = (("x", "y", "z"), ("r", "g", "b"))
CHANNELS: dict[Kind, tuple[tuple[str, ...], ...]] = {
    "vectors": (("x", "y", "z", "w"), ("r", "g", "b", "a")),
    "next": _PAIR,
    "previous": _PAIR,
    "normals": _TRIPLE,
    "position": _TRIPLE,
    "uv": (("u", "v"), ("x", "y"), ("r", "g"), ("s", "t")),
    "ids": (("x",), ("y",), ("r",), ("id",), ("v",)),
    "depth": (("z",), ("v",), ("r",), ("x",), ("y",)),
}
"""Names of the channels of each kind, in lower case, the most certain first."""


class PassName(NamedTuple):
    """A row of the table: names of one kind that programs use, the most certain first."""

    kind: Kind
    programs: str
    names: tuple[str, ...]


PASS_NAMES = (
    PassName("vectors", "Blender", ("vector",)),
    PassName("next", "Nuke", ("forward", "forwardmotion", "motionforward", "fwd")),
    PassName("next", "RenderMan", ("motionfore",)),
    PassName("next", "Arnold", ("motionvector",)),
    PassName("next", "V-Ray", ("velocity", "vrayvelocity")),
    PassName("next", "Redshift", ("motionvectors",)),
    PassName("next", "Karma", ("mv", "pixelvelocity")),
    PassName("next", "several programs", ("motion", "motionnext", "velocitynext")),
    PassName("previous", "Nuke", ("backward", "backwardmotion", "motionbackward", "bwd", "back")),
    PassName("previous", "RenderMan", ("motionback",)),
    PassName("previous", "Karma", ("backwardmv", "backwardmotionvector", "backwardmotionvectors")),
    PassName("previous", "several programs", ("motionprevious", "velocityprevious")),
    PassName("normals", "Blender, Redshift", ("normal", "normals")),
    PassName("normals", "Arnold, Karma, Redshift", ("n",)),
    PassName("normals", "V-Ray", ("vraynormals",)),
    PassName("normals", "RenderMan", ("nworld", "nn")),
    PassName("normals", "Karma", ("hitn",)),
    PassName("normals", "several programs", ("worldnormal", "cameranormal", "bumpnormals")),
    PassName("ids", "Blender before 5", ("indexob",)),
    PassName("ids", "Blender 5", ("objectindex",)),
    PassName("ids", "V-Ray, Redshift", ("objectid", "vrayobjectid", "nodeid", "vraynodeid", "renderid")),
    PassName("ids", "Arnold, RenderMan", ("id", "object")),
    PassName("depth", "Blender, Nuke, Redshift, Karma", ("depth", "z")),
    PassName("depth", "V-Ray", ("zdepth", "vrayzdepth")),
    PassName("depth", "Karma", ("pz", "hitpz")),
    PassName("depth", "Blender (mist)", ("mist",)),
    PassName("position", "Blender", ("position",)),
    PassName("position", "Arnold, Karma, Redshift", ("p",)),
    PassName("position", "Karma", ("hitp",)),
    PassName("position", "V-Ray, Redshift, RenderMan", ("worldposition", "pworld", "worldpositions")),
    PassName("uv", "Blender, Arnold, Karma", ("uv", "st", "texcoord")),
)
"""The most certain rows of a kind come first."""

CRYPTOMATTE = "crypto"
"""Part of the names of layers with Cryptomatte, whose header names them."""


def plain(name: str) -> str:
    """A component of a layer's name as the table writes it."""
    return re.sub(r"[^a-z0-9]", "", name.lower())


_ALL = frozenset(name for row in PASS_NAMES for name in row.names)


def is_pass(layer: str) -> bool:
    """Whether a layer with this name holds data and not a picture."""
    last = plain(layer.rpartition(".")[2])
    return last in _ALL or CRYPTOMATTE in last
