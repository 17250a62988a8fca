"""Passes of images with named planes: the picture, normals, object ids, depth and motion vectors.

Renderers use different names and different signs of motion vectors. Passes are identified by name: velocities
(Blender's Vector pass, Nuke's forward and backward, velocity and motion channels), normals, object ids and depth. Signs
that the name does not determine are estimated from two frames: the correct signs give the smallest warping error.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Literal, get_args

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.errors import BadInput, BadParameter
from pipeline.formats.base import Choice, PlaneImage
from pipeline.frames import Flow, Frame, Plane

Convention = Literal["auto", "cycles", "eevee", "nuke"]
Planes = Mapping[str, Plane]
Linear = NDArray[np.float32]

_BACK = (("x", "y"), ("u", "v"), ("r", "g"))
_VECTOR = (("x", "y", "z", "w"), ("r", "g", "b", "a"))
_FORTH_NAMES = ("forward", "motion_next", "velocity_next", "motionforward", "fwd", "velocity", "motion", "motionvector")
_BACK_NAMES = ("backward", "motion_previous", "velocity_previous", "motionbackward", "bwd", "back")
_PICTURES = (
    "combined", "beauty", "rgba", "image", "", "rgb", "c", "ci", "finalimage", "effectsresult", "main", "composite",
    "color", "colour",
)  # fmt: skip
"""Names of the picture among other passes, the most certain first: Blender, most renderers, Nuke, Karma, RenderMan,
Unreal, V-Ray, Redshift, Octane."""
_PICTURE_WORDS = re.compile(r"beauty|combined|final|rgba|main|master", re.IGNORECASE)
_COLOURS = (("r", "g", "b"), ("red", "green", "blue"))
_LUMINANCE = (0.2126, 0.7152, 0.0722)
_NORMALS = ("normal", "n", "normals", "worldnormal", "cameranormal")
_IDS = ("indexob", "objectid", "id", "object_id", "objectindex", "object")
_DEPTHS = ("z", "depth", "mist")


# -- the picture


@dataclass(frozen=True)
class PictureChoice:
    """The channels that hold the picture of an image, and notes for the user on the choice.

    Attributes:
        colours: names of R, G and B; or of luminance alone; or of luminance, RY and BY; empty: there is no picture.
        alpha: name of the opacity, or "".
    """

    colours: tuple[str, ...] = ()
    alpha: str = ""
    notes: tuple[str, ...] = ()
    layers: tuple[str, ...] = ()
    """Layers that hold colours, if it is unknown which of them is the picture."""

    @property
    def is_luminance(self) -> bool:
        return self.colours[0].rpartition(".")[2].lower() == "y"


def picture(image: PlaneImage, choice: Choice = Choice()) -> NDArray[np.uint8] | None:
    """The picture, uint8 (h, w, 3), or (h, w, 4) with straight alpha if it has an alpha channel; None if there is none.
    Converts linear light of the image's primaries to sRGB, clipped to 0..1, and premultiplied colours to straight
    ones.

    Raises: BadParameter: no picture has the wanted layer or view.
    """
    chosen = picture_choice(image, choice)
    if not chosen.colours:
        return None
    linear: Linear = np.nan_to_num(_colours(chosen, image.planes)).astype(np.float32)
    if image.to_709:
        linear = linear @ np.array(image.to_709, np.float32).T
    if not chosen.alpha:
        return _eight_bit(_encoded(linear))
    clear = np.clip(np.nan_to_num(image.planes[chosen.alpha]), 0, 1)[..., None]
    straight: Linear = (linear / np.maximum(clear, np.float32(1e-4))).astype(np.float32)
    return np.ascontiguousarray(np.concatenate([_eight_bit(_encoded(straight)), _eight_bit(clear)], -1))


def _colours(chosen: PictureChoice, planes: Planes) -> Linear:
    """R, G and B of stored planes. Luminance Y has RY = (R - Y) / Y and BY = (B - Y) / Y beside it, or stands alone."""
    first, *rest = (planes[name] for name in chosen.colours)
    if not rest:
        return np.stack([first] * 3, -1)
    if not chosen.is_luminance:
        return np.stack([first, *rest], -1)
    red, blue = ((plane + 1) * first for plane in rest)
    green = (first - _LUMINANCE[0] * red - _LUMINANCE[2] * blue) / _LUMINANCE[1]
    return np.stack([red, green, blue], -1)


def picture_choice(image: PlaneImage, choice: Choice = Choice()) -> PictureChoice:
    """Find the picture by the names of the channels.

    A picture is a group of channels R, G and B, or luminance, in one layer and view. Without a choice it is the one
    with the most certain name; in stereo, the first view.

    Raises: BadParameter: no picture has the wanted layer or view.
    """
    groups = _groups(image)
    view = _wanted_view(image, choice)
    if not any(of == view for _, of in groups):
        return PictureChoice()
    seen = {stem: group for (stem, of), group in groups.items() if of == view}
    named = {stem: group for stem, group in seen.items() if _is_of_layer(stem, choice.layer)}
    if not named:
        raise BadParameter("The image has no picture in this layer.", field="layer", value=choice.layer,
                           remedy=f"It has: {', '.join(stem or '(no name)' for stem in seen)}.")  # fmt: skip
    ranked = sorted(named, key=lambda stem: (_rank(stem), stem))
    best = ranked[0]
    if _rank(best) >= len(_PICTURES) + 1 and len(ranked) > 1 and not choice.layer:
        return PictureChoice(layers=tuple(ranked))
    notes = tuple(_choice_notes(image, choice, view, [stem for stem in ranked if _rank(stem) == _rank(best)]))
    colours, alpha = named[best]
    return PictureChoice(colours, alpha, (*notes, *(["The picture has luminance only."] if len(colours) == 1 else [])))


def _choice_notes(image: PlaneImage, choice: Choice, view: str, alike: list[str]) -> Iterator[str]:
    if len(image.views) > 1 and not choice.view:
        yield f"The image has the views {', '.join(image.views)}: {view} is read."
    if len(alike) > 1 and not choice.layer:
        yield f"The image has pictures in the layers {', '.join(alike)}: {alike[0]} is read."


def _wanted_view(image: PlaneImage, choice: Choice) -> str:
    if choice.view and choice.view not in image.views:
        raise BadParameter("The image has no view of this name.", field="view", value=choice.view,
                           remedy=f"It has: {', '.join(image.views) or 'one view without a name'}.")  # fmt: skip
    return choice.view or (image.views[0] if image.views else "")


def _rank(stem: str) -> int:
    """Rank of a layer by its name: the layer with the lowest rank is the picture, from 0."""
    last = stem.rpartition(".")[2].lower()
    if last in _PICTURES:
        return _PICTURES.index(last)
    return len(_PICTURES) + (0 if _PICTURE_WORDS.search(last) else 1)


def _is_of_layer(stem: str, layer: str) -> bool:
    parts = stem.lower().split(".")
    wanted = layer.lower()
    return not wanted or stem.lower() == wanted or wanted in parts


def _groups(image: PlaneImage) -> dict[tuple[str, str], tuple[tuple[str, ...], str]]:
    """(layer, view) -> names of the colour channels, and of the opacity or ""."""
    members: dict[tuple[str, str], dict[str, str]] = {}
    for full in image.planes:
        stem, _, last = full.rpartition(".")
        members.setdefault(_layer_and_view(stem, image.views), {})[last.lower()] = full
    found: dict[tuple[str, str], tuple[tuple[str, ...], str]] = {}
    for key, names in members.items():
        colours: tuple[str, ...] = next((c for c in _COLOURS if all(channel in names for channel in c)), ())
        if not colours and "y" in names and not {"x", "z", "u"} & names.keys():
            colours = ("y", "ry", "by") if {"ry", "by"} <= names.keys() else ("y",)
        if colours and not _is_data(key[0]):
            found[key] = tuple(names[channel] for channel in colours), names.get("a", names.get("alpha", ""))
    return found


def _is_data(stem: str) -> bool:
    """Whether a layer of colours is a pass of another kind, by its name."""
    last = stem.rpartition(".")[2].lower()
    return last in (*_NORMALS, *_IDS, *_DEPTHS, *_FORTH_NAMES, *_BACK_NAMES, "vector") or "crypto" in last


def _layer_and_view(stem: str, views: tuple[str, ...]) -> tuple[str, str]:
    """Layer and view of a stem; a component without a view's name belongs to the first view."""
    parts = stem.split(".") if stem else []
    view = next((part for part in parts if part in views), views[0] if views else "")
    own = [_without(part, views) for part in parts if part not in views]
    return ".".join(part for part in own if part), view


def _without(part: str, views: tuple[str, ...]) -> str:
    """A part's name without the view at its end: "rgba_left" is "rgba"."""
    view = next((view for view in views if part.endswith(("_" + view, "-" + view, " " + view))), "")
    return part[: -len(view) - 1] if view else part


def _encoded(linear: Linear) -> Linear:
    light = np.clip(linear, 0, 1)
    return np.where(light <= 0.0031308, light * 12.92, 1.055 * np.power(light, 1 / 2.4) - 0.055).astype(np.float32)


def _eight_bit(values: Linear) -> NDArray[np.uint8]:
    return np.asarray(np.rint(values * 255), np.uint8)


def normals(image: PlaneImage) -> NDArray[np.float32] | None:
    """The normal pass, float32 (h, w, 3); None if there is no such pass."""
    found = _group(image.planes, _NORMALS, ("x", "y", "z")) or _group(image.planes, _NORMALS, ("r", "g", "b"))
    return None if found is None else np.stack(found, -1)


def object_ids(image: PlaneImage) -> NDArray[np.int32] | None:
    """The object index pass, int32 (h, w); None if there is no such pass."""
    found = next((f for last in ("x", "y", "r", "id") if (f := _group(image.planes, _IDS, (last,)))), None)
    return None if found is None else np.rint(found[0]).astype(np.int32)


def data_channels(image: PlaneImage) -> tuple[str, ...]:
    """Names of the channels of an image that holds data, not a picture: R, G and B; luminance; X, Y and Z; X and Y; U
    and V; or its only channels, up to three. Empty: there are more, and none has such a name."""
    if (chosen := picture_choice(image)).colours and len(chosen.colours) in (1, 3) and not chosen.is_luminance:
        return chosen.colours
    by_name = {full.lower(): full for full in image.planes}
    for wanted in (("x", "y", "z"), ("x", "y"), ("u", "v"), ("y",)):
        for low in by_name:
            stem, _, last = low.rpartition(".")
            names = [f"{stem}.{channel}" if stem else channel for channel in wanted]
            if last == wanted[0] and all(name in by_name for name in names):
                return tuple(by_name[name] for name in names)
    others = [full for full in image.planes if full.rpartition(".")[2].lower() not in ("a", "alpha")]
    order = "rgbxyzuv"
    return tuple(sorted(others, key=lambda full: order.find(full[-1].lower()))) if len(others) <= 3 else ()


def depth(image: PlaneImage) -> Plane | None:
    """The depth pass, float32 (h, w), in the renderer's unit; None if there is no such pass."""
    found = _group(image.planes, _DEPTHS, ("z",)) or _group(image.planes, ("",), ("z",))
    return None if found is None else found[0]


def _group(planes: Planes, passes: tuple[str, ...], channels: tuple[str, ...]) -> tuple[Plane, ...] | None:
    """The planes `channels` of the first pass named as one of `passes`, in any part or layer; None = not found."""
    by_name = {full.lower(): plane for full, plane in planes.items()}
    for wanted in passes:
        for full in by_name:
            stem, _, last = full.rpartition(".")
            if last == channels[0] and stem.rpartition(".")[2] == wanted:
                found = [by_name.get(f"{stem}.{c}" if stem else c) for c in channels]
                if all(plane is not None for plane in found):
                    return tuple(plane for plane in found if plane is not None)
    return None


@dataclass(frozen=True)
class Velocities:
    """V+ and V- of benard2013stylizing, px, y down: the point at p moves to p + plus(p) and came from p - minus(p)."""

    plus: Flow | None
    minus: Flow | None


def raw_vectors(image: PlaneImage) -> tuple[str, Flow | None, Flow | None]:
    """Motion vectors as stored, without any change of sign or axis.

    Returns:
        The naming scheme ("blender" or "named"), the vectors between this and the next frame, and the vectors between
        this and the previous frame; None = missing.
    """
    for channels in _VECTOR:
        found = _group(image.planes, ("vector",), channels)
        if found is not None:
            return "blender", np.stack(found[2:], -1), np.stack(found[:2], -1)
    forth = next((f for pair in _BACK if (f := _group(image.planes, _FORTH_NAMES, pair))), None)
    back = next((f for pair in _BACK if (f := _group(image.planes, _BACK_NAMES, pair))), None)
    return "named", _stacked(forth), _stacked(back)


def _stacked(found: tuple[Plane, ...] | None) -> Flow | None:
    return None if found is None else np.stack(found, -1)


_SIGNS: Mapping[str, tuple[float, float, float]] = {
    "cycles": (-1.0, -1.0, -1.0),
    "eevee": (-1.0, 1.0, -1.0),
    "nuke": (1.0, -1.0, 1.0),
}
"""Sign factors of each convention: of the next-frame vectors (gives V+), of the previous-frame vectors (gives V-), and
of all y components."""


def signed(forth: Flow | None, back: Flow | None, factors: tuple[float, float, float]) -> Velocities:
    """Convert stored vectors to V+ and V- by sign factors; see `_SIGNS`."""
    axis = np.array([1.0, factors[2]], np.float32)

    def scaled(field: Flow | None, factor: float) -> Flow | None:
        return None if field is None else np.ascontiguousarray(field * (np.float32(factor) * axis), np.float32)

    return Velocities(scaled(forth, factors[0]), scaled(back, factors[1]))


def factors_of(
    convention: Convention, first: tuple[PlaneImage, Frame], second: tuple[PlaneImage, Frame]
) -> tuple[tuple[float, float, float], str]:
    """Sign factors of a convention, or those estimated from two frames, and a message for the job's log.

    Args:
        convention: "cycles" (XY = previous - current, ZW = current - next, y up), "eevee" (XY = current - previous),
            "nuke" (forward and backward vectors point to the pixel's position in the other frame; y as stored), or
            "auto" (the signs with the smallest warping error).
        first, second: image and picture of two consecutive frames.

    Raises:
        BadInput: the convention is unknown, or the images have no motion vectors.
    """
    if convention in _SIGNS:
        return _SIGNS[convention], f"Motion vectors use the {convention} convention."
    if convention != "auto":
        raise BadInput("The vector convention is unknown.", field="vectors", value=convention,
                       remedy=f"Use one of: {', '.join(get_args(Convention))}.")  # fmt: skip
    _, forth, _ = raw_vectors(first[0])
    _, _, back = raw_vectors(second[0])
    if forth is None and back is None:
        raise BadInput("The images contain no motion vectors.", field="vectors", remedy="Render the Vector pass.")
    signs = (1.0, -1.0)
    tried = [(a, b, c) for a in signs for b in signs for c in signs]
    scores = {f: _misfit(signed(forth, back, f), first[1], second[1]) for f in tried}
    best = min(scores, key=lambda f: (scores[f], f))
    still = _misfit(Velocities(np.zeros((*first[1].shape[:2], 2), np.float32), None), first[1], second[1])
    message = (
        f"Signs of the motion vectors were estimated: V+ = {best[0]:+.0f} next, V- = {best[1]:+.0f} previous, "
        f"y {'as stored' if best[2] > 0 else 'negated'}; warping error {scores[best]:.2f} gray levels, {still:.2f} "
        "without vectors."
    )
    return best, message


def _misfit(velocities: Velocities, first: Frame, second: Frame) -> float:
    """Mean absolute difference between each frame and the other one warped along the vectors, gray levels."""
    total, count = 0.0, 0
    if velocities.plus is not None:
        total, count = total + _unlike(first, second, velocities.plus), count + 1
    if velocities.minus is not None:
        total, count = total + _unlike(second, first, -velocities.minus), count + 1
    return total / count if count else math.inf


def _unlike(here: Frame, there: Frame, way: Flow) -> float:
    height, width = way.shape[:2]
    y, x = np.mgrid[:height, :width].astype(np.float32)
    found = cv2.remap(there, x + way[..., 0], y + way[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return float(np.abs(found.astype(np.float32) - here).mean())
