"""One frame with a design, now: what a person sees while they change it. Nothing is carried, so it takes no time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Frame
from pipeline.methods.abstraction.state import no_clock
from pipeline.methods.base import FoundRegions
from pipeline.methods.multistyle.carrier import Map
from pipeline.methods.multistyle.design import REST, Design, parse
from pipeline.methods.multistyle.designer import Placed
from pipeline.methods.multistyle.effects import effect_design
from pipeline.methods.multistyle.look import Eye
from pipeline.methods.multistyle.paint import Painter
from pipeline.methods.multistyle.params import MultistyleParams
from pipeline.methods.multistyle.regions import Given, compose
from pipeline.tensors.ellipses import Ellipse, fit_ellipse


def sketch(
    params: MultistyleParams, seed: int, frames: Sequence[Frame], number: int, total: int, *,
    document: Any = None, masks: Mapping[int, NDArray[Any]] | None = None, found: FoundRegions | None = None,
) -> Frame:  # fmt: skip
    """The last of a few consecutive frames, painted.

    Args:
        frames: uint8 (h, w, 3), the frame and some before it, which are not looked at: strokes would only fade in.
        number: of the last one in the video; total: frames of the video.
        document: the design, parsed JSON; None: the parameters' effect, if any.
        masks: label maps by frame number. Frames between keys take those of the nearest, as outlines do.
        found: tubes and objects; without, regions made of them are empty.

    Raises:
        BadParameter: the design is not sound, with the path of what is wrong.
    """
    size = (frames[0].shape[1], frames[0].shape[0])
    design = effect_design(params.effect, total)
    if document is not None:
        design = parse(document, frames=total, masks=masks is not None)
    eye = Eye(params, size, seed, no_clock, design)
    placed = None if design is None else _placed(design, masks or {}, found, number, size)
    return Painter(params, size, seed, threads=2).paint(eye.step(frames[-1], placed))


def _placed(
    design: Design, masks: Mapping[int, NDArray[Any]], found: FoundRegions | None, number: int, size: tuple[int, int]
) -> Placed:
    given = Given(design, masks, size)
    now = _map(given, number, found)
    follow = {(key.region, key.frame) for key in design.directions if key.elements and key.follow}
    keyed: dict[tuple[str, int], Ellipse] = {}
    present: dict[str, Ellipse] = {}
    for name, frame in sorted(follow):
        index = design.names.index(name)
        there = now if frame == number else _map(given, frame, found)
        own = fit_ellipse(there == index)
        here = fit_ellipse(now == index, own)
        if own is not None and here is not None:
            keyed[name, frame], present[name] = own, here
    return Placed(number, now, present, keyed)


def _map(given: Given, number: int, found: FoundRegions | None) -> Map:
    """The region map of a frame, with outlines and label maps of the nearest key."""
    planes: list[Any] = []
    for channel, keys in given.channels.items():
        nearest = min(keys, key=lambda key: (abs(key - number), key))
        planes.append(given.key(channel, nearest))
    shape = given.size[::-1]
    carried = np.stack(planes) if planes else np.zeros((0, *shape), np.uint8)
    everywhere = _Everywhere(given)
    return compose(everywhere, number, (0, 1 << 40), carried, None, *_tubes(given, number, found))


class _Everywhere(Given):
    """Keys that hold from the first frame on."""

    def __init__(self, given: Given) -> None:
        super().__init__(given.design, given.masks, given.size)
        self.channels = {channel: [0] for channel in self.channels}


def _tubes(given: Given, number: int, found: FoundRegions | None) -> tuple[NDArray[np.int64] | None, dict[int, str]]:
    """Tube numbers of a frame, and the region that each tube belongs to."""
    if found is None or not given.design.wants_tubes:
        return None, {}
    plane = found.tubes(number)
    if plane.shape != given.size[::-1]:
        small = cv2.resize(plane.astype(np.int32), given.size, interpolation=cv2.INTER_NEAREST)
        plane = np.asarray(small, np.int64)
    owner: dict[int, str] = {}
    for name, region in given.design.regions.items():
        if name != REST:
            mine = {tube for tube, own in found.objects.items() if own in region.objects} | set(region.tubes)
            owner |= dict.fromkeys(mine, name)
    return plane, owner
