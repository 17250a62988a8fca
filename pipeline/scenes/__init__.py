"""Small procedural animations with exact velocities, ids, normals and lines: demos, and ground truth for tests."""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType

from pipeline.errors import BadParameter
from pipeline.frames import MIN_SIDE_PX
from pipeline.scenes import harbour, portrait, shapes
from pipeline.scenes.base import Scene, SceneFrame
from pipeline.scenes.cut import Cut
from pipeline.scenes.stage import Stage

__all__ = ["Scene", "SceneFrame", "scene", "scenes"]

Size = tuple[int, int]
Maker = Callable[[Size, int | None, float, int], Scene]


def scenes() -> dict[str, str]:
    """Name -> description of each scene."""
    return {name: about for name, (about, _) in _SCENES.items()}


def scene(name: str, size: Size = (640, 360), frames: int | None = None, fps: float = 24.0, seed: int = 0) -> Scene:
    """Make a scene.

    Args:
        name: one of `scenes()`.
        size: (width, height), px, at least 16 each. Objects scale with the height; the width only crops the view.
        frames: number of frames; None = the scene's own duration of 2 to 4 s. Motions continue beyond it.
        fps: frames per second. Motions are defined per second, so displacements per frame depend on it.
        seed: random seed of textures and small shapes. The same arguments give the same bytes.

    Raises:
        BadParameter: an unknown name, or a size, count or rate out of range.
    """
    if name not in _SCENES:
        _refuse("name", name, f"Use one of: {', '.join(_SCENES)}.")
    if min(size) < MIN_SIDE_PX:
        _refuse("size", f"{size[0]}x{size[1]}", f"Each side is at least {MIN_SIDE_PX} px.")
    if frames is not None and frames < 1:
        _refuse("frames", frames, "At least 1.")
    if not 0 < fps <= 1000:
        _refuse("fps", fps, "Above 0 and at most 1000.")
    if seed < 0:
        _refuse("seed", seed, "At least 0.")
    return _SCENES[name][1](size, frames, fps, seed)


def _refuse(field: str, value: object, remedy: str) -> None:
    raise BadParameter("Unknown scene, or invalid argument of a scene.", field=field, value=value, remedy=remedy)


def _one(name: str, shot: ModuleType) -> Maker:
    def make(size: Size, frames: int | None, fps: float, seed: int) -> Stage:
        return Stage(name, shot.cutouts(seed), size, frames or max(1, round(shot.SECONDS * fps)), fps)

    return make


def _two(name: str, first: ModuleType, second: ModuleType) -> Maker:
    """Maker of a scene with two shots of equal length, at least one frame each."""

    def make(size: Size, frames: int | None, fps: float, seed: int) -> Cut:
        total = max(2, frames or round(4.0 * fps))
        counts = (total - total // 2, total // 2)
        shots = zip((first, second), counts, strict=True)
        return Cut(name, [Stage(name, shot.cutouts(seed), size, count, fps) for shot, count in shots])

    return make


_SCENES: dict[str, tuple[str, Maker]] = {
    "harbour": ("A bay at evening: boats, gulls behind a tree, a slow pan.", _one("harbour", harbour)),
    "portrait": ("A face that turns and blinks before drifting lights.", _one("portrait", portrait)),
    "shapes": ("Textured shapes that turn, grow and hide each other.", _one("shapes", shapes)),
    "cut": ("The harbour, then a hard cut to the portrait.", _two("cut", harbour, portrait)),
}
