"""Options of image sequences that are given with an upload: they become part of the archive."""

from __future__ import annotations

import hashlib
from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field

from pipeline.video.sequence_options import Missing, SequenceOptions, Vectors, embed, options_of


class SequenceQuery(BaseModel):
    """Query parameters of an upload, or keys of Upload-Metadata."""

    model_config = ConfigDict(extra="ignore", frozen=True)

    missing: Missing | None = Field(None, description="Numbers missing from a sequence of images: fail, hold, skip.")
    fps: str | None = Field(None, max_length=20, description="Frames per second of a sequence of images: 24000/1001.")
    pattern: str | None = Field(None, max_length=500, description="Which images: a name with ####, %04d or [1-20].")
    layer: str | None = Field(None, max_length=200, description="Layer of multi-layer images that is read.")
    view: str | None = Field(None, max_length=200, description="View of stereo images that is read.")
    vectors: Vectors | None = Field(None, description="Convention of motion vectors: auto, off, blender, nuke.")

    def options(self) -> SequenceOptions | None:
        """The options, if any is given. Raises BadParameter."""
        given = self.model_dump(exclude_none=True)
        return options_of(given, "sequence") if given else None


def with_options(path: Path, filename: str, options: SequenceOptions) -> str:
    """Put the options into the uploaded file; its new SHA-256. Raises BadParameter."""
    embed(path, filename, options)
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
