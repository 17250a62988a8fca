"""A design for frames of another size than the video's: the segmentation of smaller frames has other numbers, so
regions that name tubes and objects get label maps, which are drawn from the segmentation of the video."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from pipeline.arrays import AnyArray
from pipeline.methods.multistyle.preview import frame_regions, object_of_tubes

_KINDS = ("tubes", "objects")


def with_label_maps(design: Mapping[str, Any], files: Mapping[str, bytes]) -> tuple[dict[str, Any], _LabelMaps]:
    """The design with labels in place of numbers, and its label maps by frame.

    Args:
        design: a document without regions of labels.
        files: entries of the artefact "regions" of the video, by path.
    """
    objects = object_of_tubes(files)
    label_of: dict[int, int] = {}
    regions: dict[str, Any] = {}
    for label, (name, region) in enumerate(design["regions"].items(), 1):
        numbers, wanted = set(region.get("tubes") or ()), region.get("objects") or ()
        numbers |= {tube for tube, owner in objects.items() if owner in wanted}
        label_of |= dict.fromkeys(numbers, label)
        others = {member: value for member, value in region.items() if member not in _KINDS}
        regions[name] = {**others, "label": label} if names_segments(region) else region
    return {**design, "regions": regions}, _LabelMaps(files, label_of)


def names_segments(region: Mapping[str, Any]) -> bool:
    """Whether a region of a design is made of tubes or objects."""
    return any(region.get(kind) for kind in _KINDS)


class _LabelMaps(Mapping[int, AnyArray]):
    """uint8 (height, width) by frame, drawn on access."""

    def __init__(self, files: Mapping[str, bytes], label_of: Mapping[int, int]) -> None:
        self._files, self._label_of = files, label_of
        names = (name for name in files if name.startswith("tubes-"))
        self._frames = sorted(int(name.removeprefix("tubes-").removesuffix(".png")) for name in names)

    def __getitem__(self, frame: int) -> AnyArray:
        found = frame_regions(self._files, frame)
        if found is None:
            raise KeyError(frame)
        tubes, at = np.unique(found.numbers, return_inverse=True)
        labels = np.array([self._label_of.get(tube, 0) for tube in tubes.tolist()], np.uint8)
        return labels[at].reshape(found.numbers.shape)

    def __iter__(self) -> Iterator[int]:
        return iter(self._frames)

    def __len__(self) -> int:
        return len(self._frames)
