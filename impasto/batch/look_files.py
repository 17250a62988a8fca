"""Looks that the studio has exported, as looks of a batch."""

from __future__ import annotations

import base64
import binascii
import hashlib
import json
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from pipeline.errors import BadInput

_MOST_BYTES = 256 << 20


class _File(BaseModel):
    name: str
    data: str = Field(pattern=r"^data:[^,]*;base64,")


class _Look(BaseModel):
    """The members that a batch uses; `styles` and `regions` belong to regions that are drawn on frames."""

    model_config = ConfigDict(extra="ignore")

    title: str
    method: str
    params: dict[str, Any]
    seed: int = 0
    inputs: dict[str, str]
    styles: dict[str, Any] = {}
    regions: dict[str, Any] = {}


class _LookFile(BaseModel):
    impasto: str = Field(pattern="^look$")
    version: int = Field(ge=1, le=1)
    look: _Look
    files: dict[str, _File]


def read_look(path: Path, scratch: Path) -> tuple[dict[str, Any], tuple[str, ...]]:
    """The values of a look's table, and what of the look a batch cannot use, in sentences. Paintings are written to
    `scratch`.

    Raises BadInput: the file is no look, or lacks a painting.
    """
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise _no_look(path, f"it is larger than {_MOST_BYTES >> 20} MiB")
        found = _LookFile.model_validate(json.loads(path.read_text("utf-8")))
    except ValidationError as error:
        first = error.errors()[0]
        raise _no_look(path, f"{'.'.join(map(str, first['loc']))}: {first['msg']}") from None
    except (OSError, ValueError) as error:
        raise _no_look(path, str(error)) from None
    look = found.look
    inputs = {}
    for name, key in look.inputs.items():
        if key not in found.files:
            raise _no_look(path, f"it lacks the painting of the input {name!r}")
        inputs[name] = _written(path, found.files[key], scratch)
    values = {"method": look.method, "params": look.params, "seed": look.seed, "inputs": inputs}
    left_out = sorted({*look.regions, *look.styles})
    notes = (
        (f"The look {look.title!r} also has styles of regions ({', '.join(left_out)}): a batch has no regions, and "
         "paints every shot in the look's own style.",) if left_out else ()
    )  # fmt: skip
    return values, notes


def _written(path: Path, file: _File, scratch: Path) -> Path:
    try:
        data = base64.b64decode(file.data.partition(",")[2], validate=True)
    except binascii.Error as error:
        raise _no_look(path, f"the painting {file.name!r} is damaged: {error}") from None
    to = scratch / f"{hashlib.sha256(data).hexdigest()[:16]}-{Path(file.name).name[-80:]}"
    to.write_bytes(data)
    return to


def _no_look(path: Path, why: str) -> BadInput:
    return BadInput(
        f"The file is no look of Impasto: {why}.", field="look", value=path,
        remedy="Give a .look.json that the studio has exported (Looks, Export).",
    )  # fmt: skip
