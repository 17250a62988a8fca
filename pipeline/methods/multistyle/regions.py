"""Region maps: label maps, outlines and tubes of a design, combined into one map a frame.

Label maps and outlines are given at keyframes and propagated in both directions; between two keys a frame uses the
nearer one. Tubes come from the segmentation. Nothing is propagated across a cut.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import AnyArray, Arrays, State, flatten, part
from pipeline.errors import BadParameter
from pipeline.frames import Frame
from pipeline.methods.given_motion import GivenMotion
from pipeline.methods.multistyle.design import REST, Design
from pipeline.methods.multistyle.label_propagation import LabelPropagator, RegionMap

MASKS = "masks"
"""Channel of the input label maps; outlines of a region have a channel with the region's name."""
CORRECTIONS = "+corrections"
"""Channel of strokes that correct the other channels, and tubes; no region can have this name. Its maps have the region
number plus 1, and 0 where nothing is corrected."""
UNKNOWN = 255
"""Value of propagated maps before the first key of their channel."""


@dataclass
class RegionKeys:
    """Region maps of the keyframes, by channel.

    Args:
        design: checked.
        masks: label maps by frame number, as decoded.
        size: (width, height), px.
    """

    design: Design
    masks: Mapping[int, AnyArray]
    size: tuple[int, int]
    channels: dict[str, list[int]] = field(init=False)
    """Channel -> its keyframes in ascending order."""

    def __post_init__(self) -> None:
        self.channels = {
            name: sorted({polygon.frame for polygon in region.polygons})
            for name, region in self.design.regions.items() if region.polygons
        }  # fmt: skip
        if self.design.wants_masks:
            self.channels[MASKS] = sorted(self.masks)
        if self.design.corrections:
            self.channels[CORRECTIONS] = sorted({stroke.frame for stroke in self.design.corrections})

    def key(self, channel: str, frame: int) -> RegionMap | None:
        """The channel's map at a keyframe; None at other frames."""
        if frame not in self.channels[channel]:
            return None
        if channel == CORRECTIONS:
            return self._corrected(frame)
        return self._labels(frame) if channel == MASKS else self._outline(channel, frame)

    def _labels(self, frame: int) -> RegionMap:
        found = label_map(self.masks[frame], self.size, f"inputs.masks, frame {frame}")
        out = np.zeros(found.shape, np.uint8)
        for number, name in enumerate(self.design.names):
            if number and (label := self.design.regions[name].label) is not None:
                out[found == label] = number
        return out

    def _outline(self, name: str, frame: int) -> RegionMap:
        out = np.zeros(self.size[::-1], np.uint8)
        for polygon in self.design.regions[name].polygons:
            if polygon.frame == frame:
                cv2.fillPoly(out, [self._px(polygon.points)], self.design.names.index(name), shift=4)
        return out

    def _corrected(self, frame: int) -> RegionMap:
        out = np.zeros(self.size[::-1], np.uint8)
        for stroke in self.design.corrections:
            if stroke.frame == frame:
                width = max(1, round(stroke.width * self.size[1]))
                value = self.design.names.index(stroke.region) + 1
                points = (*stroke.points, stroke.points[-1])  # a single one is a dot
                cv2.polylines(out, [self._px(points)], False, value, width, cv2.LINE_8, shift=4)
        return out

    def _px(self, points: tuple[tuple[float, float], ...]) -> NDArray[np.int32]:
        """Positions in sixteenths of a px."""
        return np.asarray(np.rint((np.array(points, np.float64) * self.size - 0.5) * 16), np.int32)


def label_map(image: AnyArray, size: tuple[int, int], where: str) -> NDArray[np.uint16]:
    """Convert an image to a label map of the video's size: gray value, or the red channel of colour images.

    Raises:
        BadParameter: the image has another aspect ratio than the video, or colours without red.
    """
    plane = image if image.ndim == 2 else image[..., 0]
    if image.ndim == 3 and ((plane == 0) & (image[..., :3].max(axis=-1) > np.iinfo(image.dtype).max // 16)).any():
        raise BadParameter(
            "A label map has its labels as gray values or in red; this one has colours without red.",
            field="inputs.masks", value=where, remedy="Save it in gray, without a palette.",
        )  # fmt: skip
    mine = size[0] / size[1]
    if abs(plane.shape[1] / plane.shape[0] / mine - 1) > 0.02:
        raise BadParameter(
            "A label map must have the aspect ratio of the video.", field="inputs.masks",
            value=f"{plane.shape[1]}x{plane.shape[0]} in {where}",
            remedy=f"Make it {size[0]}x{size[1]}.",
        )  # fmt: skip
    if (plane.shape[1], plane.shape[0]) == size:
        return plane.astype(np.uint16)
    return np.asarray(cv2.resize(plane.astype(np.uint16), size, interpolation=cv2.INTER_NEAREST), np.uint16)


class RegionPropagator:
    """Propagates all channels from frame to frame, forwards or backwards."""

    def __init__(self, given: RegionKeys, motion: GivenMotion, forwards: bool) -> None:
        self.given, self.towards = given, 1 if forwards else -1
        self.propagators = {channel: LabelPropagator(motion) for channel in given.channels}

    def step(self, number: int, frame: Frame) -> NDArray[np.uint8]:
        """Maps of the next frame: uint8 (channels, h, w), UNKNOWN before the first key of a channel."""
        out = np.full((len(self.propagators), *frame.shape[:2]), UNKNOWN, np.uint8)
        for plane, (channel, propagator) in zip(out, self.propagators.items(), strict=True):
            key = self.given.key(channel, number)
            found = propagator.step(frame, key, number, number - self.towards, over=channel == CORRECTIONS)
            if found is not None:
                plane[:] = found
        return out

    def state(self) -> State:
        return flatten({f"channel{k}": propagator.state() for k, propagator in enumerate(self.propagators.values())})

    def restore(self, state: Arrays) -> None:
        for k, propagator in enumerate(self.propagators.values()):
            propagator.restore(part(state, f"channel{k}"))


@dataclass(frozen=True)
class Propagated:
    """Propagated maps of one frame.

    Attributes:
        number: frame number; `shot`: first frame of its shot, and the frame after the last.
        fore, back: maps propagated forwards and backwards, uint8 (channels, h, w); None = there are none.
    """

    number: int
    shot: tuple[int, int]
    fore: NDArray[np.uint8] | None
    back: NDArray[np.uint8] | None


def compose(
    given: RegionKeys, maps: Propagated, tubes: NDArray[np.int64] | None, owner: Mapping[int, str]
) -> RegionMap:
    """Combine all regions of a design into the region map of a frame.

    Args:
        tubes: int64 (h, w), tube id of each pixel; None = no region consists of tubes.
        owner: tube id -> name of its region.
    """
    design, (width, height) = given.design, given.size
    propagated = dict(_nearest_key_maps(given, maps))
    out = np.zeros((height, width), np.uint8)
    parts: dict[str, NDArray[np.bool_]] = {}
    for index, name in enumerate(design.names):
        if name == REST:
            continue
        region = design.regions[name]
        inside = np.zeros(out.shape, np.bool_)
        if (region.tubes or region.objects) and tubes is not None:
            inside |= np.isin(tubes, [tube for tube, region_name in owner.items() if region_name == name])
        for channel in (name, MASKS):
            inside |= propagated.get(channel, out) == index
        parts[name] = inside
        out[_within(design, name, parts) if region.of else inside] = index
    corrected = propagated.get(CORRECTIONS)
    return out if corrected is None else np.where(corrected > 0, corrected - 1, out).astype(np.uint8)


def _within(design: Design, name: str, parts: Mapping[str, NDArray[np.bool_]]) -> NDArray[np.bool_]:
    inside, at = parts[name], design.regions[name].of
    if at == REST:
        others = [parts[other] for other in parts if other != name]
        return inside & ~np.any(others, axis=0) if others else inside
    while at is not None and at in parts:
        inside = inside & parts[at]
        at = design.regions[at].of
    return inside


def _nearest_key_maps(given: RegionKeys, maps: Propagated) -> Iterator[tuple[str, RegionMap]]:
    """Map of each channel, propagated from the nearer keyframe; before the first key of a shot, from the next one.
    Where the nearer keyframe has no correction, the other one's holds."""
    for index, (channel, keys) in enumerate(given.channels.items()):
        before = max((key for key in keys if maps.shot[0] <= key <= maps.number), default=None)
        after = min((key for key in keys if maps.number < key < maps.shot[1]), default=None)
        use_back = after is not None and (before is None or after - maps.number < maps.number - before)
        source = maps.back if use_back else maps.fore if before is not None else None
        if source is None:
            continue
        found = _known(source[index])
        other = (maps.fore if use_back else maps.back) if channel == CORRECTIONS else None
        yield channel, found if other is None else np.where(found > 0, found, _known(other[index])).astype(np.uint8)


def _known(plane: RegionMap) -> RegionMap:
    return np.where(plane == UNKNOWN, 0, plane).astype(np.uint8)
