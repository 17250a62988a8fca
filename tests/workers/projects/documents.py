"""A document in which every part is used, and the assets that it names."""

from __future__ import annotations

from typing import Any

from pipeline.methods import layer_parts
from workers.contract.record import Asset

SIZE, FRAMES = (96, 64), 24


def asset_id(letter: str) -> str:
    return "ast_" + letter * 64


def asset(letter: str, kind: str = "image", **info: Any) -> Asset:
    media = {"image": "image/png", "video": "video/mp4", "json": "application/json"}[kind]
    known = {"width": SIZE[0], "height": SIZE[1], "frames": FRAMES if kind == "video" else 1}
    return Asset(asset_id(letter), letter * 64, 10, f"{letter}.bin", media, kind, {**known, **info}, 1.0)


ASSETS = {found.id: found for found in (asset("a", "video"), *(asset(letter) for letter in "bcdef"))}


def layer(method: str, **members: Any) -> dict[str, Any]:
    """A layer; members that it does not have are its parts."""
    parts = {name: value for name, value in members.items() if name in layer_parts()}
    own = {name: value for name, value in members.items() if name not in parts}
    return {"id": "l1", "method": method, **own} | ({"parts": parts} if parts else {})


def document(*layers: dict[str, Any], **members: Any) -> dict[str, Any]:
    """One shot with these layers."""
    names = {"clip": "a", "wave": "b", "key-12": "c", "mask-12": "d", "map-0": "e", "fg-0": "f"}
    return {
        "schema": 2,
        "name": "Swan",
        "assets": {name: {"id": asset_id(letter)} for name, letter in names.items()},
        "shots": [{"id": "s1", "video": "clip", "layers": list(layers)}],
        **members,
    }


DESIGNED = layer(
    "multistyle",
    params={"style": "pointillism"},
    design={
        "regions": {"swan": {"label": 1}, "sky": {"polygons": [{"frame": 0, "points": [[0, 0], [1, 0], [1, 0.4]]}]}},
        "styles": {"calm": {"base": "watercolor", "size": 30}},
        "keys": [
            {"region": "swan", "frame": 0, "style": "calm"},
            {"region": "swan", "frame": 20, "style": "van-gogh"},
        ],
        "directions": [{"region": "sky", "frame": 4, "elements": [{"pattern": "center", "at": [0.5, 0.5]}]}],
    },
    region_maps=[{"frame": 0, "image": "map-0"}],
)
