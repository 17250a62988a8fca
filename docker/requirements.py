"""Prints the dependencies that an image installs: `requirements.py cpu` or `requirements.py gpu`."""

from __future__ import annotations

import sys
import tomllib
from pathlib import Path

FARM = ("cluster", "s3", "postgresql")
EXTRAS = {"cpu": ("cpu", *FARM), "gpu": FARM}


def requirements(project: Path, device: str) -> list[str]:
    """The dependencies that `project` declares, with the extras for a device of this kind, without our own client."""
    found = tomllib.loads(project.read_text("utf-8"))["project"]
    rows = [*found["dependencies"], *(row for extra in EXTRAS[device] for row in found["optional-dependencies"][extra])]
    return [row for row in rows if not row.startswith("impasto-client")]


if __name__ == "__main__":
    if len(sys.argv) != 2 or sys.argv[1] not in EXTRAS:
        sys.exit(f"usage: requirements.py {'|'.join(EXTRAS)}")
    print("\n".join(requirements(Path("pyproject.toml"), sys.argv[1])))
