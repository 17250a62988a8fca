"""The picture of an image with named planes, by the names of its layers; other passes: `pipeline.passes`."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import AnyArray
from pipeline.colour import ocio
from pipeline.errors import BadParameter
from pipeline.formats.base import Choice, PlaneImage
from pipeline.frames import Plane
from pipeline.passes.find import layers_of
from pipeline.passes.names import is_pass

Planes = Mapping[str, Plane]
Linear = NDArray[np.float32]

_PICTURES = (
    "combined", "beauty", "rgba", "image", "", "rgb", "c", "ci", "finalimage", "effectsresult", "main", "composite",
    "color", "colour",
)  # fmt: skip
"""Names of the picture among other passes, the most certain first: Blender, most renderers, Nuke, Karma, RenderMan,
Unreal, V-Ray, Redshift, Octane."""
_PICTURE_WORDS = re.compile(r"beauty|combined|final|rgba|main|master", re.IGNORECASE)
_COLOURS = (("r", "g", "b"), ("red", "green", "blue"))
_LUMINANCE = (0.2126, 0.7152, 0.0722)


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
    layer: str = ""
    """Layer of the picture, such as "ViewLayer.Combined"."""
    alike: tuple[str, ...] = ()
    """Layers that are the picture by their names, this one first."""

    @property
    def is_luminance(self) -> bool:
        return self.colours[0].rpartition(".")[2].lower() == "y"


def picture(image: PlaneImage, choice: Choice = Choice()) -> AnyArray | None:
    """The picture, uint8 (h, w, 3), or (h, w, 4) with straight alpha if it has an alpha channel; None if there is none.
    Converts linear light of the image's primaries to sRGB, clipped to 0..1, and premultiplied colours to straight
    ones. With `choice.deep`, float32 that is not clipped.

    Raises: BadParameter: no picture has the wanted layer or view.
    """
    chosen = picture_choice(image, choice)
    if not chosen.colours:
        return None
    linear: Linear = np.nan_to_num(_colours(chosen, image.planes)).astype(np.float32)
    if image.to_709 and not choice.colour:
        linear = linear @ np.array(image.to_709, np.float32).T
    if not chosen.alpha:
        return _shown(linear, choice)
    clear = np.clip(np.nan_to_num(image.planes[chosen.alpha]), 0, 1)[..., None]
    straight: Linear = (linear / np.maximum(clear, np.float32(1e-4))).astype(np.float32)
    return np.concatenate([_shown(straight, choice), clear if choice.deep else _eight_bit(clear)], -1)


def _shown(light: Linear, choice: Choice) -> AnyArray:
    """Display-referred sRGB of linear light of Rec. 709, or of the colours of the space that is given."""
    if choice.colour or choice.colour_view:
        values = ocio.to_display(light, choice.colour or ocio.LINEAR_709, choice.colour_view)
    else:
        values = ocio.encoded(light) if choice.deep else _encoded(light)
    return values if choice.deep else _eight_bit(np.clip(values, 0, 1))


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
    alike = [stem for stem in ranked if _rank(stem) == _rank(best)]
    notes = [*_choice_notes(image, choice, view, alike)]
    colours, alpha = named[best]
    if len(colours) == 1:
        notes.append("The picture has luminance only.")
    return PictureChoice(colours, alpha, tuple(notes), (), best, tuple(alike))


def samples(count: int) -> list[int]:
    """Numbers of the frames that are looked at for a choice of pictures: the first, the middle and the last one."""
    return sorted({0, count // 2, count - 1})


def settled_choice(
    choice: Choice, names: PlaneImage, images: Callable[[], Iterator[PlaneImage]]
) -> tuple[Choice, tuple[str, ...]]:  # fmt: skip
    """The choice of a sequence whose frames have several pictures of equal names, as view layers have: the first layer
    that has a picture in some frame; and a note on it. Other choices are returned as they are.

    Args:
        names: names of the channels; planes may be empty.
        images: some frames of the sequence.

    Raises: BadParameter: no picture has the wanted layer or view.
    """
    alike = picture_choice(names, choice).alike
    if choice.layer or len(alike) < 2:
        return choice, ()
    for image in images():
        for layer in alike:
            own = replace(choice, layer=layer)
            found = picture_choice(image, own)
            if any(np.any(np.nan_to_num(image.planes[name])) for name in found.colours):
                why = "" if layer == alike[0] else ", the first one that is not empty"
                note = f"The frames have pictures in the layers {', '.join(alike)}: {layer} is read{why}."
                return own, (note,)
    return choice, ()


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
    found: dict[tuple[str, str], tuple[tuple[str, ...], str]] = {}
    for key, names in layers_of(image).items():
        colours: tuple[str, ...] = next((c for c in _COLOURS if all(channel in names for channel in c)), ())
        if not colours and "y" in names and not {"x", "z", "u"} & names.keys():
            colours = ("y", "ry", "by") if {"ry", "by"} <= names.keys() else ("y",)
        if colours and not is_pass(key[0]):
            found[key] = tuple(names[channel] for channel in colours), names.get("a", names.get("alpha", ""))
    return found


def _encoded(linear: Linear) -> Linear:
    light = np.clip(linear, 0, 1)
    return np.where(light <= 0.0031308, light * 12.92, 1.055 * np.power(light, 1 / 2.4) - 0.055).astype(np.float32)


def _eight_bit(values: Linear) -> NDArray[np.uint8]:
    return np.asarray(np.rint(values * 255), np.uint8)


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
