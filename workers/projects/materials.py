"""The content of a job's inputs: uploaded assets, images by frame, JSON. Images and JSON become new assets.

Equal content gives equal bytes, and so the same asset, on every machine.
"""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from pipeline.formats import image_format
from pipeline.video.writer import zip_entry


@dataclass(frozen=True)
class Uploaded:
    """An uploaded asset."""

    asset_id: str


@dataclass(frozen=True)
class ImagesByFrame:
    """Images of single frames: (frame number as the job counts, asset id), ascending."""

    images: tuple[tuple[int, str], ...]


@dataclass(frozen=True)
class JsonValue:
    """A JSON document, as its canonical text."""

    text: str

    @staticmethod
    def of(value: object) -> JsonValue:
        return JsonValue(json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=False))


Material = Uploaded | ImagesByFrame | JsonValue


def write_material(
    material: ImagesByFrame | JsonValue, path: Path, read: Callable[[str], bytes], numbers: Sequence[int] = ()
) -> str:
    """Write the input's file at `path` and return a file name for it.

    Args:
        read: the bytes of an asset, by its id.
        numbers: numbers of the video's frames, if it is a sequence of images: images are named by them.
    """
    if isinstance(material, JsonValue):
        path.write_text(material.text, "utf-8")
        return "document.json"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as archive:
        for frame, asset_id in material.images:
            data = read(asset_id)
            number = numbers[frame] if frame < len(numbers) else frame
            archive.writestr(zip_entry(f"{number:07d}.{_suffix(data)}"), data)
    return "frames.zip"


def _suffix(data: bytes) -> str:
    form = image_format(data[:4096])
    return "png" if form is None else form.suffixes[0][1:]
