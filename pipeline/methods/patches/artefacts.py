"""What a job can be asked to show: label maps, panoramas and paintings of patches, distortion before and after.

labels    16 bit gray PNGs by frame, at the frame's size: to be corrected and sent back as the input `labels`
patches   each patch's panorama and its painting
energy    a JSON per patch, and maps of where it is distorted, before and after relaxation
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
from pipeline.methods.base import Bench
from pipeline.methods.patches.grid import Grid
from pipeline.video.writer import zip_entry

ARTEFACTS = ("labels", "patches", "energy")


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


def label_png(labels: Labels, grid: Grid) -> bytes:
    """A label map at the frame's size."""
    full = cv2.resize(labels.astype(np.uint16), (grid.width, grid.height), interpolation=cv2.INTER_NEAREST)
    return png(full)


def keep_labels(bench: Bench, key: str, maps: Mapping[int, bytes]) -> None:
    """Keep a run's label maps, if the job asked for them."""
    if maps:
        bench.save_file(f"labels-{key}", pack({f"{index:06d}.png": data for index, data in maps.items()}), _ZIP)


def keep_patch(bench: Bench, key: str, panorama: Frame, painting: Frame) -> None:
    """Keep a patch's pictures, if the job asked for them."""
    if bench.wants("patches"):
        files = {f"{key}-panorama.png": png(panorama), f"{key}-painting.png": png(painting)}
        bench.save_file(f"patches-{key}", pack(files), _ZIP)


def keep_energy(bench: Bench, key: str, report: Mapping[str, Any], before: Plane, after: Plane) -> None:
    """Keep a patch's energies and where they are, if the job asked for them; both maps in one scale."""
    if bench.wants("energy"):
        top = max(float(before.max(initial=0)), 1e-6)
        files = {f"{key}.json": json.dumps(report, indent=1, sort_keys=True).encode()}
        for name, plane in (("before", before), ("after", after)):
            files[f"{key}-{name}.png"] = png(heat(plane / np.float32(top)))
        bench.save_file(f"energy-{key}", pack(files), _ZIP)


def heat(plane: Plane) -> Frame:
    """0..1 as black over red and yellow to white, uint8 (h, w, 3); by the square root, so that little is seen too."""
    level = np.sqrt(np.clip(plane, 0, 1)) * 3
    shown = np.dstack([np.clip(level - part, 0, 1) for part in range(3)])
    return np.asarray(np.rint(shown * 255), np.uint8)


_ZIP = "application/zip"
