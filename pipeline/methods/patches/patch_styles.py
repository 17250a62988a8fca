"""Styles and parameters of single patches, from the input "styles" (zhang2011patches, section 6)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydantic import JsonValue, ValidationError

from pipeline.errors import BadParameter
from pipeline.methods.patches.params import PatchesParams

BACKGROUND = 1
"""Label of what moves as most of the frame does; objects are 2, 3, ..."""
MAX_LABEL = 65535
"""Largest label: label maps are 16-bit images."""
OF_PATCHES = ("style", "stroke_size", "threshold", "jitter", "relief")
"""Parameters that a patch may have of its own."""

PatchStyles = Mapping[int, Mapping[str, Any]]
"""Label -> its own values of parameters of `OF_PATCHES`."""


def label_styles(given: JsonValue) -> PatchStyles:
    """The document "styles": label -> style, or label -> parameters. The key "background" means label 1.

    Raises:
        BadParameter: a key is not a label, or a style or a parameter is unknown or out of range; `field` is the JSON
            path.
    """
    if not isinstance(given, dict):
        raise BadParameter("Styles must be an object: label -> style.", field="inputs.styles",
                           value=type(given).__name__,
                           remedy='For example {"background": "wash", "3": "circles"}.')  # fmt: skip
    found = {}
    for key, style in given.items():
        number = BACKGROUND if key == "background" else int(key) if key.isdecimal() else 0
        if not 0 < number <= MAX_LABEL:
            raise BadParameter('A key must be a label, or "background".', field=f"inputs.styles.{key}", value=key,
                               remedy="Labels are the gray values of the artefact `labels`, from 1.")  # fmt: skip
        field = f"inputs.styles.{key}"
        if isinstance(style, dict):
            found[number] = {name: _checked(name, value, f"{field}.{name}") for name, value in style.items()}
        else:
            found[number] = {"style": _checked("style", style, field)}
    return found


def _checked(name: str, value: JsonValue, field: str) -> Any:
    """The value of a parameter of a patch, as the method's own parameter has it."""
    if name not in OF_PATCHES:
        raise BadParameter("A patch has no such parameter of its own.", field=field, value=name,
                           remedy=f"Use one of: {', '.join(OF_PATCHES)}.")  # fmt: skip
    try:
        return getattr(PatchesParams.model_validate({name: value}), name)
    except ValidationError as error:
        raise BadParameter(f"{error.errors()[0]['msg']}.", field=field, value=value,
                           remedy=f"See the parameter {name} of `impasto methods patches`.") from None  # fmt: skip


def params_of(label: int, params: PatchesParams, own: PatchStyles, background: bool = False) -> PatchesParams:
    """Parameters of a patch: its own in `own`, else those of the background if it belongs to it, else the job's."""
    background = background or label == BACKGROUND
    styled = {"style": params.background_style} if background and params.background_style != "same" else {}
    inherited = own.get(BACKGROUND, {}) if background else {}
    return params.model_copy(update={**styled, **inherited, **own.get(label, {})})
