"""Parsing of NAME=VALUE in `--param`, `--input`, `--label` and `--artefact`."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

from pipeline.errors import BadInput, BadParameter
from workers.model import Json

T = TypeVar("T")


def params(options: Sequence[str]) -> Json:
    """`["sigma_px=1.5", "lines=off"]` -> `{"sigma_px": 1.5, "lines": "off"}`.

    A value that is JSON is taken as JSON, anything else as text: `off`, `on` and names need no quotes.
    """
    return _pairs(options, "--param", "sigma_px=1.5", _json_or_text)


def inputs(options: Sequence[str]) -> dict[str, Path]:
    """`["reference=wave.jpg"]` -> `{"reference": Path("wave.jpg")}`; `video` is the first argument, not an option."""
    found = _pairs(options, "--input", "reference=painting.jpg", lambda text: Path(text).expanduser())
    if "video" in found:
        raise BadInput(
            "The input 'video' is the first argument.",
            field="--input",
            value=f"video={found['video']}",
            remedy="Give the video as IN, without --input.",
        )
    return found


def labels(options: Sequence[str]) -> dict[str, str]:
    """`["shot=12"]` -> `{"shot": "12"}`."""
    return _pairs(options, "--label", "shot=12", str)


def artefacts(options: Sequence[str]) -> dict[str, Path | None]:
    """`["svg", "labels=out/labels.zip"]` -> `{"svg": None, "labels": Path("out/labels.zip")}`."""
    named = [option if "=" in option else f"{option}=" for option in options]
    return _pairs(named, "--artefact", "svg=frames.zip", lambda text: Path(text).expanduser() if text else None)


def frames(text: str) -> tuple[int, int] | None:
    """`"10:60"` -> `(10, 60)`, first frame and one past the last; empty: None."""
    if not text:
        return None
    first, _, end = text.partition(":")
    if not (first.isdecimal() and end.isdecimal()):
        raise BadParameter("FIRST:END is expected.", field="--frames", value=text, remedy="Write --frames 10:60.")
    return int(first), int(end)


def _pairs(options: Sequence[str], flag: str, example: str, read: Callable[[str], T]) -> dict[str, T]:
    found: dict[str, T] = {}
    for option in options:
        name, equals, text = option.partition("=")
        name = name.strip()
        if not name or not equals:
            raise BadParameter("NAME=VALUE is expected.", field=flag, value=option, remedy=f"Write {flag} {example}.")
        if name in found:
            raise BadParameter(f"{name!r} is given twice.", field=flag, value=option, remedy="Give it once.")
        found[name] = read(text)
    return found


def _json_or_text(text: str) -> Any:
    try:
        return json.loads(text)
    except ValueError:
        return text
