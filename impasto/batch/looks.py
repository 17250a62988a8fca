"""The configuration of a batch (TOML): where media are, how shots are painted, and how results are named."""

from __future__ import annotations

import string
import tomllib
from collections.abc import Mapping
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from impasto.batch.look_files import read_look
from pipeline.errors import BadParameter, did_you_mean
from pipeline.method_names import DEFAULT
from workers.contract.request import Alpha

TOKENS = ("cut", "shot", "event", "clip", "source", "reel", "look", "method", "version")
"""Tokens of names. `version` has three digits."""


M = TypeVar("M", bound=BaseModel)


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Look(_Table):
    """How a shot is painted: as the options of `impasto render`."""

    method: str = DEFAULT
    params: dict[str, Any] = {}
    inputs: dict[str, Path] = Field(default={}, description="Files, relative to the configuration.")
    seed: int = Field(default=0, ge=0)
    quality: int = Field(default=20, ge=0, le=51)
    profile: str = ""
    alpha: Alpha = "auto"
    on_damage: Literal["warn", "fail"] = "warn"


class Rule(_Table):
    """Shots whose name fits `match` ("sh01*") get the look. The last rule that fits counts."""

    match: str
    look: str


class Config(_Table):
    names: str = Field(
        default="{shot}_v{version}.mp4",
        description="Names of results in the output folder, by tokens; the extension is the format.",
    )
    handles: int = Field(default=0, ge=0, le=10_000, description="Frames before and after each shot, painted too.")
    media: list[Path] = Field(default=[], description="Folders that are searched for media, with their folders.")
    fps: float | None = Field(
        default=None,
        gt=0,
        le=1000,
        description="Frame rate of an EDL, and of images in a manifest.",
    )
    look: Look = Look()
    looks: dict[str, dict[str, Any]] = Field(default={}, description="Other looks: what differs from `look`.")
    shots: list[Rule] = []

    def look_of(self, shot: str, named: str = "", changes: Mapping[str, Any] | None = None) -> tuple[str, Look]:
        """The name and the look of a shot. `named`: a look that the manifest names; `changes`: its own values.

        Raises BadParameter.
        """
        name = named or next((rule.look for rule in reversed(self.shots) if fnmatchcase(shot, rule.match)), "")
        if name and name not in self.looks:
            raise BadParameter(
                "There is no such look.", field="look", value=name, remedy=did_you_mean(name, self.looks, "looks")
            )
        values = self.look.model_dump()
        for table in (self.looks.get(name, {}), changes or {}):
            if table.get("method", values["method"]) != values["method"]:
                values |= {"params": {}, "inputs": {}}  # those of another method
            values |= {k: {**values.get(k, {}), **v} if isinstance(v, dict) else v for k, v in table.items()}
        return name or "look", _parsed(Look, values, f"looks.{name}" if name else "look")


def load_config(path: Path | None, scratch: Path, look: Path | None = None) -> tuple[Config, tuple[str, ...]]:
    """Read a configuration, and what of its looks' files cannot be used, in sentences.

    Args:
        path: None: everything has its default.
        scratch: a folder for the paintings of looks in files.
        look: a file with the look of every shot to which no rule gives another one; it is added to `[look]`.

    Raises: BadParameter that names the field; BadInput: a look's file is none.
    """
    base = path.parent if path else Path()
    values = {} if path is None else _read(path)
    notes: list[str] = []
    if look is not None:
        values["look"] = {**values.get("look", {}), "file": str(look.absolute())}
    tables = [values.get("look"), *(values["looks"].values() if isinstance(values.get("looks"), dict) else ())]
    for table in tables:
        if isinstance(table, dict) and "file" in table:
            found, left_out = read_look(base / str(table.pop("file")), scratch)
            notes += left_out
            own = {**found, **table}
            own |= {name: {**found[name], **table.get(name, {})} for name in ("params", "inputs")}
            table.update(own)
    config = _parsed(Config, values, "")
    check_names(config.names)
    for name in config.looks:
        config.look_of("", name)
    for rule in config.shots:
        config.look_of("", rule.look)
    return config.model_copy(update={"media": [base / folder for folder in config.media]}), tuple(notes)


def _read(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text("utf-8"))
    except (OSError, ValueError) as error:
        raise BadParameter(
            f"The configuration cannot be read: {error}.", field="--config", value=path, remedy="Give a TOML file."
        ) from None


def check_names(names: str) -> None:
    """Raise BadParameter unless the names have only known tokens, and the version."""
    parts = [part for part in string.Formatter().parse(names) if part[1] is not None]
    found = [str(name) for _, name, _, _ in parts]
    if any(form or conversion for _, _, form, conversion in parts):
        raise BadParameter("Tokens have no format.", field="names", value=names, remedy="Write {version}, for example.")
    for token in found:
        if token not in TOKENS:
            remedy = did_you_mean(token, TOKENS, "tokens")
            raise BadParameter("The token is unknown.", field="names", value=token, remedy=remedy)
    if "version" not in found:
        raise BadParameter(
            "The names have no version.", field="names", value=names,
            remedy="Add {version}: a result is never overwritten.",
        )  # fmt: skip


def _parsed(kind: type[M], values: Mapping[str, Any], field: str) -> M:
    try:
        return kind.model_validate(values)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in (field, *first["loc"]) if part != "")
        raise BadParameter(
            f"{first['msg']}.", field=place, value=first.get("input"), remedy="docs/batch.md lists the fields."
        ) from None
