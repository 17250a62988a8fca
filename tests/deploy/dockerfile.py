"""A Dockerfile as its stages and their instructions, with build arguments put in."""

from __future__ import annotations

import io
import re
from dataclasses import dataclass, field
from pathlib import Path

from dockerfile_parse import DockerfileParser


@dataclass
class Stage:
    base: str
    name: str
    steps: list[tuple[str, str]] = field(default_factory=list)
    """(instruction, value), in order."""

    def all(self, instruction: str) -> list[str]:
        return [value for kind, value in self.steps if kind == instruction]


def stages(path: Path) -> dict[str, Stage]:
    """Name -> stage."""
    found: dict[str, Stage] = {}
    parser = DockerfileParser(fileobj=io.BytesIO(path.read_bytes()))
    for row in parser.structure:
        kind, value = row["instruction"], row["value"]
        if kind == "FROM":
            base, _, name = value.partition(" AS ")
            current = found[name] = Stage(base, name)
        elif kind != "COMMENT" and found:
            current.steps.append((kind, value))
    return found


def chain(found: dict[str, Stage], name: str, device: str) -> list[Stage]:
    """The stages that an image is made on, the first one last."""
    stage = found[name]
    base = stage.base.replace("${DEVICE}", device)
    return [stage, *(chain(found, base, device) if base in found else [])]


def kept_by(ignore: Path, names: list[str]) -> set[str]:
    """Files of the build context: the last pattern that matches a file or one of its parent folders decides."""
    rules = [row for row in ignore.read_text().splitlines() if row and not row.startswith("#")]
    return {name for name in names if _kept(name, rules)}


def _kept(name: str, rules: list[str]) -> bool:
    kept = True
    for rule in rules:
        pattern = rule.removeprefix("!")
        shape = re.escape(pattern).replace(r"\*\*/", "(?:.*/)?").replace(r"\*", "[^/]*")
        if re.fullmatch(f"{shape}(?:/.*)?", name):
            kept = rule.startswith("!")
    return kept
