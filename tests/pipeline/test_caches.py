"""Memory of long-running processes: no cached function keeps a result for each seed or parameter set."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from pipeline.strokes.bristles import fine_tile, tile
from pipeline.strokes.paper import paper
from pipeline.strokes.random import KEPT_TEXTURES

ROOT = Path(__file__).resolve().parents[2]
FEW_ARGUMENTS = {
    "pipeline/compute/signature.py": {"signature", "_compiled"},  # kernels of the program
    "pipeline/kernels/kernel_cache.py": {"_use", "stamp_of", "_imported", "_text"},  # files of the program
    "pipeline/methods/__init__.py": {"_loaded"},  # methods of the program
    "pipeline/strokes/emboss.py": {"weave"},  # called with one seed
    "pipeline/synthesis/energy.py": {"taps"},  # radii of patches
    "service/methods/thumbnail.py": {"thumbnail"},  # methods of the program
    "workers/projects/document.py": {"_type_of"},  # methods of the program
    "workers/store/state_counts.py": {"_addition"},  # kinds of databases
    "workers/process/free_memory.py": {"_return_free_memory_regularly"},  # called once
}
"""Functions with unbounded caches, whose arguments users cannot choose freely."""


@pytest.mark.parametrize("texture", [tile, fine_tile, paper])
def test_textures_of_few_seeds_are_kept(texture: object) -> None:
    for seed in range(KEPT_TEXTURES + 3):
        texture(seed)  # type: ignore[operator]
    assert texture.cache_info().currsize == KEPT_TEXTURES  # type: ignore[attr-defined]


def test_a_cache_without_bound_has_few_arguments() -> None:
    found: dict[str, set[str]] = {}
    for folder in ("impasto", "pipeline", "service", "workers"):
        for file in (ROOT / folder).rglob("*.py"):
            for node in ast.walk(ast.parse(file.read_text())):
                if isinstance(node, ast.FunctionDef) and _is_unbounded(node) and node.args.args:
                    found.setdefault(file.relative_to(ROOT).as_posix(), set()).add(node.name)
    assert found == FEW_ARGUMENTS


def _is_unbounded(function: ast.FunctionDef) -> bool:
    texts = {ast.unparse(decorator) for decorator in function.decorator_list}
    return bool(texts & {"cache", "functools.cache", "lru_cache(maxsize=None)", "lru_cache(None)"})
