# SPDX-License-Identifier: GPL-3.0-or-later
"""ComfyUI's IMAGE and MASK tensors as files to upload, and painted frames as tensors.

IMAGE: float32 (frames, height, width, 3 or 4), 0..1, sRGB. MASK: float32 (frames, height, width), 1 = transparent.
"""

from __future__ import annotations

import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import torch

from impasto_client import BadInput, BadParameter
from impasto_client.frames import png, read_frames, write_frames


def write_video(images: Any, fps: float, folder: Path, name: str) -> Path:
    """All frames in order, 16 bits a channel, as a zip that the service reads as a video."""
    path = folder / f"{name}.zip"
    write_frames(path, _arrays(images), fps)
    return path


def write_picture(images: Any, folder: Path, name: str) -> Path:
    """One picture as PNG. Raises: BadInput (several)."""
    if len(images) != 1:
        raise BadInput(f"The input '{name}' is one picture.", field=name, value=f"{len(images)} pictures",
                       remedy="Choose one, for example with ImageFromBatch.")  # fmt: skip
    path = folder / f"{name}.png"
    path.write_bytes(png(_arrays(images)[0]))
    return path


def write_keys(images: Any, frames: str, folder: Path, name: str) -> Path:
    """Pictures as a zip, named by frame numbers. Raises: BadParameter (not as many numbers as pictures)."""
    numbers = [int(word) for word in frames.replace(",", " ").split() if word.isdecimal()]
    if len(set(numbers)) != len(images) or len(frames.replace(",", " ").split()) != len(images):
        raise BadParameter("Each picture needs its frame number.", field=f"{name}_frames", value=frames,
                           remedy=f"Give {len(images)} different numbers, from 0, with commas between.")  # fmt: skip
    path = folder / f"{name}.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as archive:
        for number, image in zip(numbers, _arrays(images), strict=True):
            archive.writestr(zipfile.ZipInfo(f"{number:07d}.png"), png(image))
    return path


def write_document(text: str, folder: Path, name: str) -> Path:
    """A JSON document. Raises: BadParameter (not JSON)."""
    try:
        document = json.loads(text)
    except ValueError as error:
        raise BadParameter(f"It is not JSON: {error}.", field=name, value=text, remedy="Correct it.") from error
    path = folder / f"{name}.json"
    path.write_text(json.dumps(document), "utf-8")
    return path


def read_tensors(path: Path) -> tuple[Any, Any]:
    """IMAGE (three channels) and MASK of a "png" result; the mask is 0 where the result has no opacity."""
    frames = np.stack(list(read_frames(path)))
    images = torch.from_numpy(frames[..., :3].astype(np.float32) / 255)
    opacity = frames[..., 3] if frames.shape[3] == 4 else np.full(frames.shape[:3], 255, np.uint8)
    return images, torch.from_numpy(1 - opacity.astype(np.float32) / 255)


def _arrays(images: Any) -> Any:
    return images.cpu().numpy()
