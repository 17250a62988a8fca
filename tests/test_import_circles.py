"""No module imports itself through others, imports within functions and for type checkers included."""

from __future__ import annotations

import ast
from graphlib import TopologicalSorter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("impasto", "service", "workers", "pipeline", "client/impasto_client")


def _name(path: Path) -> str:
    parts = path.relative_to(ROOT / "client" if path.is_relative_to(ROOT / "client") else ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def _imports(path: Path, modules: set[str]) -> set[str]:
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names = {f"{node.module}.{alias.name}" for alias in node.names}
            found |= names if names <= modules else (names & modules) | {node.module}
    return found & modules


def test_packages_have_no_import_cycle() -> None:
    files = [path for package in PACKAGES for path in (ROOT / package).rglob("*.py")]
    paths = {_name(path): path for path in files if not {"migrations", "node_modules"} & set(path.parts)}
    graph = {name: _imports(path, set(paths)) for name, path in paths.items()}
    assert len(graph) > 300
    TopologicalSorter(graph).prepare()  # raises CycleError, which names the circle
