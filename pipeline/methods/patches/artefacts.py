"""Artefacts of a job: label maps, panoramas and paintings of patches, distortion before and after relaxation.

labels    16-bit gray PNGs by frame, at the frame's size; they can be edited and sent back as the input `labels`
overlay   the same label maps as colours over the frames, for viewing
patches   panorama and painting of each patch
energy    a JSON a patch, and maps of its distortion before and after relaxation
"""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Mapping
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Frame, Labels, Plane
from pipeline.methods.base import TaskContext
from pipeline.methods.patches.params import PatchesParams
from pipeline.methods.patches.soft_labels import SoftLabels
from pipeline.video.writer import zip_entry

LABELS, OVERLAY = "labels", "overlay"
ARTEFACTS = (LABELS, OVERLAY, "patches", "energy")


def png(image: NDArray[Any]) -> bytes:
    """A gray (8 or 16 bit) or RGB picture as PNG."""
    shown = cv2.cvtColor(image, cv2.COLOR_RGB2BGR) if image.ndim == 3 else image
    done, data = cv2.imencode(".png", shown)
    assert done
    return data.tobytes()


def pack(files: Mapping[str, bytes]) -> bytes:
    """A zip of files by name, the same bytes for the same files."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as target:
        for name in sorted(files):
            target.writestr(zip_entry(name), files[name])
    return stream.getvalue()


class LabelPictures:
    """Collects the artefacts "labels" and "overlay" of a run of frames, as far as the job asked for them."""

    def __init__(self, context: TaskContext[Any]) -> None:
        self._context = context
        self._files: dict[str, dict[str, bytes]] = {name: {} for name in (LABELS, OVERLAY) if context.wants(name)}

    @property
    def wanted(self) -> bool:
        return bool(self._files)

    def add(self, index: int, soft: SoftLabels) -> None:
        """Add frame `index`."""
        full = soft.full()
        if LABELS in self._files:
            self._files[LABELS][f"{index:06d}.png"] = png(full.astype(np.uint16))
        if OVERLAY in self._files:
            self._files[OVERLAY][f"{index:06d}.png"] = png(overlay(full, soft.frame))

    def save(self, key: str) -> None:
        for name, files in self._files.items():
            self._context.save_file(f"{name}-{key}", pack(files), _ZIP)


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
    around = np.ones((3, 3), np.uint8)
    plane = labels.astype(np.float32)
    out[cv2.dilate(plane, around) != cv2.erode(plane, around)] = 255
    return np.asarray(out, np.uint8)


def keep_patch(context: TaskContext[PatchesParams], key: str, panorama: Frame, painting: Frame) -> None:
    """Keep a patch's pictures, if the job asked for them."""
    if context.wants("patches"):
        files = {f"{key}-panorama.png": png(panorama), f"{key}-painting.png": png(painting)}
        context.save_file(f"patches-{key}", pack(files), _ZIP)


def keep_energy(
    context: TaskContext[PatchesParams], key: str, report: Mapping[str, Any], before: Plane, after: Plane
) -> None:
    """Keep a patch's energies and where they are, if the job asked for them; both maps in one scale."""
    if context.wants("energy"):
        top = max(float(before.max(initial=0)), 1e-6)
        files = {f"{key}.json": json.dumps(report, indent=1, sort_keys=True).encode()}
        for name, plane in (("before", before), ("after", after)):
            files[f"{key}-{name}.png"] = png(heat(plane / np.float32(top)))
        context.save_file(f"energy-{key}", pack(files), _ZIP)


def heat(plane: Plane) -> Frame:
    """0..1 as black over red and yellow to white, uint8 (h, w, 3); by the square root, so that little is seen too."""
    level = np.sqrt(np.clip(plane, 0, 1)) * 3
    shown = np.dstack([np.clip(level - part, 0, 1) for part in range(3)])
    return np.asarray(np.rint(shown * 255), np.uint8)


_ZIP = "application/zip"
