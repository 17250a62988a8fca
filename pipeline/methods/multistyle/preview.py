"""Preview of one frame with a design. Regions are not propagated, so that it takes a fraction of a second."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import AnyArray
from pipeline.errors import BadParameter
from pipeline.frames import Frame
from pipeline.methods.base import FrameRegions, PreviewRequest
from pipeline.methods.multistyle.analysis import StrokeAnalysis
from pipeline.methods.multistyle.analyzer import StrokeAnalyzer
from pipeline.methods.multistyle.design import REST, Design, followed, parse
from pipeline.methods.multistyle.design_fields import RegionPlacement
from pipeline.methods.multistyle.effects import effect_design
from pipeline.methods.multistyle.label_propagation import RegionMap
from pipeline.methods.multistyle.painter import Painter
from pipeline.methods.multistyle.params import MultistyleParams
from pipeline.methods.multistyle.regions import Propagated, RegionKeys, compose
from pipeline.methods.tasks import no_clock
from pipeline.tensors.ellipses import Ellipse, fit_ellipse
from pipeline.tensors.field import angle_of, strength_of


@dataclass(frozen=True)
class FoundRegions:
    """Regions that an earlier job found in the video: its artefact "regions".

    Attributes:
        tubes: frame -> tube number of each pixel, int64 (height, width), at any size.
        objects: tube number -> object number.
    """

    tubes: Callable[[int], NDArray[np.int64]]
    objects: Mapping[int, int]


def preview_frame(request: PreviewRequest[MultistyleParams], found: FoundRegions | None = None) -> Frame:
    """The last frame of the request, painted. The frames before it do not influence it.

    The inputs "design" and "masks" and the artefact "regions" of an earlier job are used where they are given.
    Without "regions", regions made of tubes or objects are empty. Between keys, label maps and outlines of the nearest
    key are used.

    Args:
        found: regions of the video; None: those of the artefact "regions".

    Raises:
        BadParameter: the design is unsound, with the path of the fault.
    """
    params, size = request.params, (request.frames[0].shape[1], request.frames[0].shape[0])
    return Painter(params, size, request.seed, threads=2).paint(_analysis(request, found))


def preview_directions(request: PreviewRequest[MultistyleParams]) -> NDArray[np.float32]:
    """Angle, radians in [0, pi), and strength of the strokes in the last frame: float32 (h', w', 2)."""
    field = _analysis(request, None).field.astype(np.float32).transpose(2, 0, 1)
    return np.stack([angle_of(field), strength_of(field)], axis=-1).astype(np.float32)


def _analysis(request: PreviewRequest[MultistyleParams], found: FoundRegions | None) -> StrokeAnalysis:
    params, number = request.params, request.number
    size = (request.frames[0].shape[1], request.frames[0].shape[0])
    design = effect_design(params.effect, request.total)
    masks = request.images.get("masks")
    if (document := request.documents.get("design")) is not None:
        design = parse(document, frames=request.total, masks=masks is not None)
    if found is None and "regions" in request.artefacts:
        found = _found(request.artefacts["regions"])
    analyzer = StrokeAnalyzer(params, size, request.seed, no_clock, design)
    placed = None if design is None else _placed(design, masks or {}, found, number, size)
    return analyzer.step(request.frames[-1], placed)


def frame_regions(files: Mapping[str, bytes], frame: int) -> FrameRegions | None:
    """Tubes of a frame from the entries of the artefact "regions"; None if it has no such frame."""
    name = f"tubes-{frame:07d}.png"
    if name not in files:
        return None
    coded = np.asarray(cv2.imdecode(np.frombuffer(files[name], np.uint8), cv2.IMREAD_COLOR), np.int64)
    return FrameRegions(coded[..., 2] << 16 | coded[..., 1] << 8 | coded[..., 0], object_of_tubes(files))


def _found(files: Mapping[str, bytes]) -> FoundRegions:
    def tubes(frame: int) -> NDArray[np.int64]:
        found = frame_regions(files, frame)
        if found is None:
            raise BadParameter(
                "The earlier job found no regions in this frame.", field="artefacts.regions", value=frame,
                remedy="Use a job that rendered this frame of the video.",
            )  # fmt: skip
        return found.numbers

    return FoundRegions(tubes, object_of_tubes(files))


def object_of_tubes(files: Mapping[str, bytes]) -> dict[int, int]:
    """Object of each tube, from the entries of the artefact "regions"."""
    return {row["tube"]: row["object"] for row in json.loads(files["regions-list.json"])["tubes"]}


def _placed(
    design: Design, masks: Mapping[int, AnyArray], found: FoundRegions | None, number: int, size: tuple[int, int]
) -> RegionPlacement:
    given = RegionKeys(design, masks, size)
    now = _map(given, number, found)
    keyed: dict[tuple[str, int], Ellipse] = {}
    present: dict[str, Ellipse] = {}
    for name, frame in followed(design):
        index = design.names.index(name)
        there = now if frame == number else _map(given, frame, found)
        own = fit_ellipse(there == index)
        here = fit_ellipse(now == index, own)
        if own is not None and here is not None:
            keyed[name, frame], present[name] = own, here
    return RegionPlacement(number, now, present, keyed)


def _map(given: RegionKeys, number: int, found: FoundRegions | None) -> RegionMap:
    """Region map of a frame, with outlines and label maps of the nearest key."""
    planes: list[RegionMap] = []
    for channel, keys in given.channels.items():
        nearest = min(keys, key=lambda key: (abs(key - number), key))
        key = given.key(channel, nearest)
        assert key is not None  # `nearest` is a keyframe of the channel
        planes.append(key)
    shape = given.size[::-1]
    planes_of_keys = np.stack(planes) if planes else np.zeros((0, *shape), np.uint8)
    maps = Propagated(number, (0, 1 << 40), planes_of_keys, None)
    return compose(_FromStart(given), maps, *_tubes(given, number, found))


class _FromStart(RegionKeys):
    """The same keys, valid from the first frame on."""

    def __init__(self, given: RegionKeys) -> None:
        super().__init__(given.design, given.masks, given.size)
        self.channels = {channel: [0] for channel in self.channels}


def _tubes(
    given: RegionKeys, number: int, found: FoundRegions | None
) -> tuple[NDArray[np.int64] | None, dict[int, str]]:
    """Tube number of each pixel of a frame, and the region of each tube."""
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
