"""Options for reading an image sequence: gaps, frame rate, choice of files, layer and view.

The options travel with the images, as the file `sequence.json` of their archive, so that every reader of the archive
finds the same frames.
"""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from fractions import Fraction
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator

from pipeline.errors import BadParameter
from pipeline.formats import image_format_of
from pipeline.formats.base import Choice
from pipeline.video.media import SEQUENCE_FPS

OPTIONS_FILE = "sequence.json"
MAX_FPS = 1000
_EPOCH = (1980, 1, 1, 0, 0, 0)
Missing = Literal["fail", "hold", "skip"]
Vectors = Literal["auto", "off", "blender", "nuke"]


class SequenceOptions(BaseModel):
    """Options of an image sequence, and of a single image with several layers."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    missing: Missing = Field(
        "fail", description="Numbers that are missing: refuse, show the frame before again, or leave them out."
    )
    fps: float | str = Field(
        SEQUENCE_FPS, description='Frames per second, a number or a fraction such as "24000/1001".'
    )
    pattern: str = Field("", max_length=500, description="Which files: a name with ####, %04d or [1-20].")
    layer: str = Field("", max_length=200, description="Layer or part whose picture is read; empty: the usual one.")
    view: str = Field("", max_length=200, description="View of a stereo image; empty: the first one.")
    vectors: Vectors = Field(
        "auto", description="Convention of motion vectors: found by warping, not used, or that of a program."
    )

    @field_validator("fps")
    @classmethod
    def _is_rate(cls, value: float | str) -> float | str:
        if not 0 < _rate(value) <= MAX_FPS:
            raise ValueError(f"use a number above 0 and at most {MAX_FPS}")
        return value

    @property
    def rate(self) -> Fraction:
        return _rate(self.fps)

    @property
    def choice(self) -> Choice:
        return Choice(self.layer, self.view)

    @property
    def given(self) -> dict[str, object]:
        """The options that differ from the defaults."""
        return self.model_dump(exclude_defaults=True)

    def document(self) -> bytes:
        """The contents of `sequence.json`; the same options give the same bytes."""
        return self.model_validate(self.given).model_dump_json(exclude_defaults=True).encode()


USUAL = SequenceOptions()


def _rate(value: float | str) -> Fraction:
    try:
        return Fraction(value).limit_denominator(100_000)
    except (ValueError, ZeroDivisionError, OverflowError):
        raise ValueError("use a number, or a fraction such as 24000/1001") from None


def options_of(values: Mapping[str, object] | bytes, prefix: str = OPTIONS_FILE) -> SequenceOptions:
    """Options from their values, or from the bytes of `sequence.json`. Raises BadParameter that names the option.

    Args:
        prefix: what comes before the option's name in the field of the error.
    """
    try:
        if isinstance(values, bytes):
            return SequenceOptions.model_validate_json(values)
        return SequenceOptions.model_validate(values)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        name = ".".join(str(part) for part in first["loc"][:1])
        raise BadParameter(
            f"{first['msg'].removeprefix('Value error, ')[:200]}.", field=f"{prefix}: {name}" if name else prefix,
            value=first.get("input"),
            remedy="missing: fail, hold or skip; fps; pattern; layer; view; vectors: auto, off, blender or nuke.",
        ) from None  # fmt: skip


def embed(path: Path, name: str, options: SequenceOptions) -> None:
    """Put options into a zip of images, or make a zip with them of one image; the file at `path` is changed.

    Args:
        name: file name of an image, for its entry.

    Raises: BadParameter: the file is neither, or has options already.
    """
    with path.open("rb") as stream:
        image = image_format_of(stream) is not None
    if image:
        single = path.replace(path.with_name(f"{path.name}.image"))
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr(zipfile.ZipInfo(name, _EPOCH), single.read_bytes())
        single.unlink()
    elif not zipfile.is_zipfile(path):
        raise BadParameter("Options of image sequences are given for another file.", field=", ".join(options.given),
                           value=name, remedy="Leave them out: a video has its own times.")  # fmt: skip
    with zipfile.ZipFile(path, "a") as archive:
        if any(entry.rpartition("/")[2] == OPTIONS_FILE for entry in archive.namelist()):
            raise BadParameter(f"The archive has a {OPTIONS_FILE} of its own.", field=", ".join(options.given),
                               value=name, remedy="Leave the options out, or change that file.")  # fmt: skip
        archive.writestr(zipfile.ZipInfo(OPTIONS_FILE, _EPOCH), options.document())
