"""Regions through time: what tells where each is in a frame, put together to one map.

Label maps and outlines are given in keyframes and carried from there in both directions; between two keys a frame
takes what comes from the nearer one. Tubes come from the segmentation. Nothing is carried over a cut.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.errors import BadParameter
from pipeline.frames import Frame
from pipeline.methods.abstraction.state import State, flatten, part
from pipeline.methods.multistyle.carrier import Carrier, Map
from pipeline.methods.multistyle.design import REST, Design

MASKS = "masks"
"""The channel of the user's label maps; outlines of a region have a channel of its name."""
NOWHERE = 255


@dataclass
class Given:
    """What the user has said of where regions are: the keys of every channel.

    Args:
        design: checked.
        masks: label maps by frame number, as stored.
        size: (width, height), px.
    """

    design: Design
    masks: Mapping[int, NDArray[Any]]
    size: tuple[int, int]
    channels: dict[str, list[int]] = field(init=False)
    """Channel -> its keyframes, ascending."""

    def __post_init__(self) -> None:
        self.channels = {
            name: sorted(polygon.frame for polygon in region.polygons)
            for name, region in self.design.regions.items() if region.polygons
        }  # fmt: skip
        if self.design.wants_masks:
            self.channels[MASKS] = sorted(self.masks)

    def key(self, channel: str, frame: int) -> Map | None:
        """The channel's map in a keyframe; None in any other."""
        if frame not in self.channels[channel]:
            return None
        return self._labels(frame) if channel == MASKS else self._outline(channel, frame)

    def _labels(self, frame: int) -> Map:
        found = label_map(self.masks[frame], self.size, f"inputs.masks, frame {frame}")
        out = np.zeros(found.shape, np.uint8)
        for number, name in enumerate(self.design.names):
            if number and (label := self.design.regions[name].label) is not None:
                out[found == label] = number
        return out

    def _outline(self, name: str, frame: int) -> Map:
        polygon = next(p for p in self.design.regions[name].polygons if p.frame == frame)
        corners = np.array(polygon.points, np.float64) * self.size - 0.5
        out = np.zeros(self.size[::-1], np.uint8)
        cv2.fillPoly(out, [np.rint(corners * 16).astype(np.int32)], self.design.names.index(name), shift=4)
        return out


def label_map(image: NDArray[Any], size: tuple[int, int], where: str) -> NDArray[np.uint16]:
    """A stored image as label map at the video's size: gray as it is, colours by their red channel.

    Raises:
        BadParameter: it has another shape than the video.
    """
    plane = image if image.ndim == 2 else image[..., 0]
    mine = size[0] / size[1]
    if abs(plane.shape[1] / plane.shape[0] / mine - 1) > 0.02:
        raise BadParameter(
            "A label map has the shape of the video.", field="inputs.masks",
            value=f"{plane.shape[1]}x{plane.shape[0]} in {where}",
            remedy=f"Make it {size[0]}x{size[1]}.",
        )  # fmt: skip
    if (plane.shape[1], plane.shape[0]) == size:
        return plane.astype(np.uint16)
    return np.asarray(cv2.resize(plane.astype(np.uint16), size, interpolation=cv2.INTER_NEAREST), np.uint16)


class Walk:
    """Carries every channel from frame to frame, forwards or backwards. Its state can be handed on."""

    def __init__(self, given: Given) -> None:
        self.given = given
        self.carriers = {channel: Carrier() for channel in given.channels}

    def step(self, number: int, frame: Frame) -> NDArray[np.uint8]:
        """uint8 (channels, h, w), NOWHERE where the channel has had no key yet."""
        out = np.full((len(self.carriers), *frame.shape[:2]), NOWHERE, np.uint8)
        for plane, (channel, carrier) in zip(out, self.carriers.items(), strict=True):
            found = carrier.step(frame, self.given.key(channel, number))
            if found is not None:
                plane[:] = found
        return out

    def state(self) -> State:
        return flatten({f"channel{k}": carrier.state() for k, carrier in enumerate(self.carriers.values())})

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        for k, carrier in enumerate(self.carriers.values()):
            carrier.restore(part(state, f"channel{k}"))


def compose(
    given: Given, number: int, shot: tuple[int, int], fore: NDArray[np.uint8] | None, back: NDArray[np.uint8] | None,
    tubes: NDArray[np.int64] | None, owner: Mapping[int, str],
) -> Map:  # fmt: skip
    """The region map of a frame.

    Args:
        number: of the frame; `shot`: the first of its shot, and the one after its last.
        fore, back: what was carried to it, uint8 (channels, h, w); None = nothing came from there.
        tubes: int64 (h, w), the id of the tube that each pixel is in; None = no region is made of tubes.
        owner: tube -> the region it belongs to.
    """
    design, (width, height) = given.design, given.size
    carried = dict(_nearer(given, number, shot, fore, back))
    out = np.zeros((height, width), np.uint8)
    parts: dict[str, NDArray[np.bool_]] = {}
    for index, name in enumerate(design.names):
        if name == REST:
            continue
        region = design.regions[name]
        if region.tubes or region.objects:
            mine = np.array([tube for tube, region_name in owner.items() if region_name == name], np.int64)
            inside = np.isin(tubes, mine) if tubes is not None else np.zeros(out.shape, np.bool_)
        else:
            inside = carried.get(MASKS if region.label is not None else name, out) == index
        parts[name] = inside
        out[_within(design, name, parts) if region.of else inside] = index
    return out


def _within(design: Design, name: str, parts: Mapping[str, NDArray[np.bool_]]) -> NDArray[np.bool_]:
    inside, at = parts[name], design.regions[name].of
    if at == REST:
        others = [parts[other] for other in parts if other != name]
        return inside & ~np.any(others, axis=0) if others else inside
    while at is not None and at in parts:
        inside = inside & parts[at]
        at = design.regions[at].of
    return inside


def _nearer(
    given: Given, number: int, shot: tuple[int, int], fore: NDArray[np.uint8] | None, back: NDArray[np.uint8] | None
) -> Iterator[tuple[str, Map]]:
    for index, (channel, keys) in enumerate(given.channels.items()):
        before = max((key for key in keys if shot[0] <= key <= number), default=None)
        after = min((key for key in keys if number < key < shot[1]), default=None)
        use_back = after is not None and (before is None or after - number < number - before)
        source = back if use_back else fore if before is not None else None
        if source is not None:
            yield channel, np.where(source[index] == NOWHERE, 0, source[index]).astype(np.uint8)
