"""Artefacts of a job: label maps, panoramas and paintings of patches, distortion before and after relaxation.

labels    16-bit gray PNGs by frame, at the frame's size; they can be edited and sent back as the input `labels`
uncertainty  JSON files by run: frame -> label -> uncertainty, 0..1
overlay   the same label maps as colours over the frames, for viewing
patches   panorama and painting of each patch
energy    a JSON file for each patch, and maps of its distortion before and after relaxation
"""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Mapping

import cv2
import numpy as np

from pipeline.arrays import AnyArray
from pipeline.frames import Frame, Labels, Plane
from pipeline.methods.base import TaskContext, TaskResult
from pipeline.methods.patches.params import PatchesParams
from pipeline.regions.mattes import LabelMattes
from pipeline.video.writer import zip_entry

LABELS, OVERLAY, UNCERTAINTY = "labels", "overlay", "uncertainty"
ARTEFACTS = (LABELS, OVERLAY, UNCERTAINTY, "patches", "energy")


def png(image: AnyArray) -> bytes:
    """Encode a gray (8 or 16 bit) or RGB picture as PNG."""
    channels = cv2.cvtColor(image, cv2.COLOR_RGB2BGR) if image.ndim == 3 else image
    encoded, data = cv2.imencode(".png", channels)
    assert encoded
    return data.tobytes()


def zip_files(files: Mapping[str, bytes]) -> bytes:
    """A zip of files by name; the same files give the same bytes."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as target:
        for name in sorted(files):
            target.writestr(zip_entry(name), files[name])
    return stream.getvalue()


class LabelPictures:
    """Collects the artefacts "labels" and "overlay" of a run of frames, as far as the job requests them."""

    def __init__(self, context: TaskContext[PatchesParams]) -> None:
        self._context = context
        self._files: dict[str, dict[str, bytes]] = {name: {} for name in (LABELS, OVERLAY) if context.wants(name)}
        self._uncertainty: dict[str, dict[str, float]] = {}

    @property
    def requested(self) -> bool:
        """Whether the job requests at least one of them."""
        return bool(self._files) or self._context.wants(UNCERTAINTY)

    def add(self, index: int, mattes: LabelMattes, uncertainty: Mapping[int, float]) -> None:
        """Add frame `index`. `uncertainty`: of each label, 0..1."""
        labels = mattes.full()
        self._uncertainty[str(index)] = {str(label): value for label, value in uncertainty.items()}
        if LABELS in self._files:
            self._files[LABELS][f"{index:06d}.png"] = png(labels.astype(np.uint16))
        if OVERLAY in self._files:
            self._files[OVERLAY][f"{index:06d}.png"] = png(overlay(labels, mattes.frame))

    def save(self, key: str) -> None:
        """Save the run's files; `key` is the key of its task."""
        if self._context.wants(UNCERTAINTY):
            data = json.dumps(self._uncertainty).encode()
            self._context.save_file(f"{UNCERTAINTY}-{key}.json", data, "application/json")
        for name, files in self._files.items():
            self._context.save_file(f"{name}-{key}", zip_files(files), _ZIP)


def overlay(labels: Labels, frame: Frame) -> Frame:
    """The frame tinted with a colour per label, with white borders; unclustered pixels are gray: uint8 (h, w, 3).

    Args:
        labels: int32 (h, w), at the frame's size.
    """
    hue = (np.arange(int(labels.max(initial=0)) + 1) * 111.25 % 180).astype(np.uint8)
    hsv = np.stack([hue, np.full_like(hue, 200), np.full_like(hue, 255)], axis=-1)[None]
    colours = cv2.cvtColor(hsv, cv2.COLOR_HSV2RGB)[0]
    colours[0] = 128
    out = cv2.addWeighted(frame, 0.5, np.ascontiguousarray(colours[labels], np.uint8), 0.5, 0)
    square = np.ones((3, 3), np.uint8)
    plane = labels.astype(np.float32)
    out[cv2.dilate(plane, square) != cv2.erode(plane, square)] = 255
    return np.asarray(out, np.uint8)


def save_patch_artefact(
    context: TaskContext[PatchesParams], key: str, number: int, panorama: Frame, painting: AnyArray
) -> None:
    """Save panorama and painting of period `number` of a patch, if the job requests the artefact "patches"."""
    if context.wants("patches"):
        name = f"{key}-age{number}"
        files = {f"{name}-panorama.png": png(panorama), f"{name}-painting.png": png(painting)}
        context.save_file(f"patches-{name}", zip_files(files), _ZIP)


def save_energy_artefact(
    context: TaskContext[PatchesParams], key: str, report: TaskResult, before: Plane, after: Plane
) -> None:
    """Save the energies of a patch and maps of its distortion, if the job requests the artefact "energy".

    Args:
        report: energies, as JSON values.
        before, after: float32 (h, w), distortion before and after relaxation; both maps have the same scale.
    """
    if context.wants("energy"):
        top = max(float(before.max(initial=0)), 1e-6)
        files = {f"{key}.json": json.dumps(report, indent=1, sort_keys=True).encode()}
        for name, plane in (("before", before), ("after", after)):
            files[f"{key}-{name}.png"] = png(heat_map(plane / np.float32(top)))
        context.save_file(f"energy-{key}", zip_files(files), _ZIP)


def heat_map(plane: Plane) -> Frame:
    """Colours of values 0..1, from black over red and yellow to white: uint8 (h, w, 3).

    The scale is the square root of the value, so that small values are visible.
    """
    level = np.sqrt(np.clip(plane, 0, 1)) * 3
    colours = np.dstack([np.clip(level - channel, 0, 1) for channel in range(3)])
    return np.asarray(np.rint(colours * 255), np.uint8)


_ZIP = "application/zip"
