"""Nothing outside a method's folder names a method, or an input, artefact or parameter of one.

The names are those of the registry. A method's name is a word that no text of the program contains, other than
docstrings and comments. Inputs, artefacts and parameters have names that other things have too (`labels`, `style`,
`opacity`), so that they count where they are used as such: as a member of `params`, `inputs`, `artefacts` and their
like, or in an address. Names of several words count anywhere in the pages, and as texts in the platform, which use them
for nothing else. The rooms of algorithms below the methods have quantities of their own, so that only methods' names
count there.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from pipeline.method_names import BUILT_IN, PLATFORM
from pipeline.methods import method, methods

ROOT = Path(__file__).parents[1]
PAGES = ROOT / "service" / "web" / "src"
PACKAGES = ("pipeline", "workers", "service", "impasto")
REGISTRY = ROOT / "pipeline" / "method_names.py"
ALGORITHMS = {"perception", "regions", "strokes", "synthesis", "solvers", "lines", "colour", "vector"}
"""Rooms of the pipeline."""
OWNERS = {"params", "inputs", "artefacts", "defaults", "properties", "documents", "images"}
"""Names of mappings and objects whose members are parameters, inputs or artefacts."""


def method_names() -> set[str]:
    return set(BUILT_IN)


@cache
def member_names() -> set[str]:
    known = [methods()[name] for name in BUILT_IN]
    inputs = {spec.name for one in known for spec in one.inputs} - {"video"}
    own = {name for one in PLATFORM for name in method(one).Params.model_fields}
    return (inputs | {name for one in known for name in (*one.artefacts, *one.Params.model_fields)}) - own


def _one_of(names: set[str]) -> str:
    return f"(?:{'|'.join(sorted(names))})"


# -- pages


def _code(text: str) -> str:
    """TypeScript without its comments; lines stay where they are."""
    return re.sub(r"/\*.*?\*/|(?<![:\"'`/])//[^\n]*", lambda found: "\n" * found[0].count("\n"), text, flags=re.S)


def page_faults(text: str) -> list[str]:
    """What names a method, or a member of one."""
    name, owner = _one_of(member_names()), _one_of(OWNERS)
    several = _one_of({one for one in member_names() if "_" in one})
    patterns = (
        rf"[\"'`/]{_one_of(method_names())}(?=[\"'`/?])",
        rf"\b{owner}(?:\?\.|\.|\??\.?\[[\"']){name}\b(?!\()",  # params.x, inputs?.["x"]
        rf"\b{owner}(?:\??: |: \w+ = | = )\{{[^{{}}]*(?<!: )\b{name}\b[?]?[:,}} ]",  # params: {{ x: ... }}
        rf"\{{[^{{}}=]*\b{name}\b[^{{}}=]*\}} = [^;\n]*\b{owner}\b",  # const {{ x }} = layer.params
        rf"\b(?:{owner}|results)\.\w+\([\"']{name}[\"']",  # artefacts.includes("x")
        rf"/{owner}/{name}\b",
        rf"\b{several}\b",
    )
    code = _code(text)
    return [found[0] for pattern in patterns for found in re.finditer(pattern, code)]


def test_no_page_names_a_method_or_a_member_of_one() -> None:
    sources = sorted(path for path in PAGES.rglob("*") if path.suffix in (".ts", ".tsx"))
    assert len(sources) > 100
    found = {str(path.relative_to(PAGES)): page_faults(path.read_text()) for path in sources}
    assert {path: faults for path, faults in found.items() if faults} == {}


@pytest.mark.parametrize("line", [
    'if (layer.method === "patches") draw();', "get(url`/v1/methods/multistyle/inputs/design/examples`);",
    "const { effect: _effect, ...params } = layer.params ?? {};", "params?.cut_sensitivity", "schema.properties?.style",
    "const set = { params: { style: name } };", "api.url`/v1/jobs/${film.id}/artefacts/labels/${at}.png`",
    'inputs["style_output"]', 'job.artefacts.includes("uncertainty")', "layer.inputs?.reference",
])  # fmt: skip
def test_a_line_of_a_page_that_names_one_is_found(line: str) -> None:
    assert page_faults(line)


@pytest.mark.parametrize("line", [
    'type Tool = "label" | "direction";', "store.brush.value = { color, size, opacity: 1 };", "<div style={{ left }}>",
    "// the method patches", "request.labels.project", "node.style.left = `${x}px`;",
])  # fmt: skip
def test_a_line_of_a_page_that_uses_such_a_word_for_something_else_is_not(line: str) -> None:
    assert page_faults(line) == []


# -- Python


def _docstrings(tree: ast.AST) -> Iterator[ast.Constant]:
    """Docstrings, of attributes too: constants that are whole statements."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            yield node.value


def _owner(node: ast.AST) -> str:
    return node.id if isinstance(node, ast.Name) else node.attr if isinstance(node, ast.Attribute) else ""


def _members(node: ast.AST) -> Iterator[str]:
    """Names that a node uses as members of an owner."""
    if isinstance(node, ast.Attribute) and _owner(node.value) in OWNERS:
        yield node.attr
    elif isinstance(node, ast.Subscript) and _owner(node.value) in OWNERS and isinstance(node.slice, ast.Constant):
        yield str(node.slice.value)
    elif isinstance(node, ast.Call):
        yield from _of_call(node)
    elif isinstance(node, ast.Assign) and any(_owner(target) in OWNERS for target in node.targets):
        yield from _keys(node.value)
    elif isinstance(node, ast.Dict):
        for key, value in zip(node.keys, node.values, strict=True):
            if isinstance(key, ast.Constant) and key.value in OWNERS:
                yield from _keys(value)
    elif isinstance(node, ast.Compare) and any(_owner(other) in OWNERS for other in node.comparators):
        yield str(getattr(node.left, "value", ""))


def _of_call(node: ast.Call) -> Iterator[str]:
    first = node.args[0] if node.args else None
    if isinstance(node.func, ast.Attribute) and _owner(node.func.value) in OWNERS and isinstance(first, ast.Constant):
        yield str(first.value)
    if _owner(node.func) == "getattr" and len(node.args) > 1 and isinstance(node.args[1], ast.Constant):
        yield str(node.args[1].value)
    for keyword in node.keywords:
        if keyword.arg in OWNERS:
            yield from _keys(keyword.value)


def _keys(node: ast.AST) -> Iterator[str]:
    """Constants of a literal that a mapping or a list of names is made of, conditional ones included."""
    for inner in ast.walk(node):
        if isinstance(inner, ast.Dict):
            yield from (str(key.value) for key in inner.keys if isinstance(key, ast.Constant))
        elif isinstance(inner, ast.List | ast.Tuple | ast.Set):
            yield from (str(item.value) for item in inner.elts if isinstance(item, ast.Constant))


def python_faults(text: str, members: bool = True) -> list[str]:
    """Line numbers and texts of what names a method, or a member of one. `members`: whether to look for the latter."""
    tree = ast.parse(text)
    skipped = {id(node) for node in _docstrings(tree)}
    named = re.compile(rf"\b{_one_of(method_names())}\b")
    names = member_names() if members else set()
    several = {name for name in names if "_" in name}
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in skipped:
            found += [f"{node.lineno}: {word[0]}" for word in named.finditer(node.value)]
            found += [f"{node.lineno}: {node.value}"] if node.value in several else []
        found += [f"{node.lineno}: {name}" for name in _members(node) if name in names]  # type: ignore[attr-defined]
    return found


def python_sources() -> list[Path]:
    folders = [path for path in (ROOT / "pipeline" / "methods").iterdir() if path.is_dir()]
    return [
        path.relative_to(ROOT) for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py"))
        if path != REGISTRY and "node_modules" not in path.parts and not any(one in path.parents for one in folders)
    ]  # fmt: skip


def test_no_module_outside_the_methods_names_a_method_or_a_member_of_one() -> None:
    assert len(python_sources()) > 300
    found = {
        path: python_faults((ROOT / path).read_text(), ALGORITHMS.isdisjoint(path.parts)) for path in python_sources()
    }
    assert {str(path): faults for path, faults in found.items() if faults} == {}


@pytest.mark.parametrize("line", [
    'remedy = "Choose a method with the part keys, such as analogy."', 'method: str = "abstraction"',
    'documents = {} if design is None else {"design": design}', 'x = getattr(params, "cut_sensitivity", 1.0)',
    'value = layer.params.get("temporal")', 'request = {"params": {"lines": "off"}}',
    'if "labels" in job.artefacts: pass', 'name = "style_output"',
    "context.params.stroke_size", 'submit(inputs={"style_output": painting})', 'output = {"artefacts": ["svg"]}',
])  # fmt: skip
def test_a_line_that_names_one_is_found(line: str) -> None:
    assert python_faults(line)


@pytest.mark.parametrize("line", [
    '"""Paints as the method analogy does."""', 'labels = {"shot": "12"}', 'field = "body.labels"', "row.style",
    "self.regions = regions",
])  # fmt: skip
def test_a_line_that_uses_such_a_word_for_something_else_is_not(line: str) -> None:
    assert python_faults(line) == []
