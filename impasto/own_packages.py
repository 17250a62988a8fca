"""The command's own packages, also where PYTHONPATH or the working folder has others of these names.

Only the command does this. A program that imports `impasto` and has a `pipeline` of its own needs another environment.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from types import ModuleType

NAMES = frozenset({"pipeline", "service", "workers"})
ROOT = str(Path(__file__).resolve().parents[1])


class OwnPackages:
    """Finds the packages beside `impasto`; the usual finders find everything else."""

    @staticmethod
    def find_spec(name: str, path: Sequence[str] | None = None, target: ModuleType | None = None) -> ModuleSpec | None:
        return PathFinder.find_spec(name, [ROOT]) if name in NAMES else None


sys.meta_path.insert(0, OwnPackages)
