"""Types of the client's answers, from the OpenAPI document: `python client/make_models.py` writes them."""

from __future__ import annotations

import json
import keyword
import pathlib
import subprocess
import sys
import textwrap
from collections.abc import Iterator

from service.app import openapi_document
from workers.contract.request import Json

FILE = pathlib.Path(__file__).resolve().parent / "impasto_client" / "models.py"
NAMES = {
    "JobOut": "Job", "Asset": "Asset", "MethodOut": "Method", "ProjectOut": "Project", "ProjectJobOut": "ProjectJob",
    "ProjectVersion": "ProjectVersion", "VersionOut": "VersionOfProject", "TaskView": "Task", "StepView": "Step",
}  # fmt: skip
"""Schemas that the client answers with, and the names of their types; what they refer to keeps its name."""
REQUEST = ("JobIn", "JobOptions", frozenset({"method", "inputs", "params"}))
"""The body of a job: schema, type, and what `submit` takes as arguments of their own."""
HEAD = '''"""The API's JSON objects: made from the OpenAPI document by `python client/make_models.py`, do not edit.

A service of another version may have more fields, or lack some.
"""

from __future__ import annotations

from typing import Any, Literal, TypedDict
'''
PLAIN = {"string": "str", "number": "float", "integer": "int", "boolean": "bool", "null": "None"}


def document() -> str:
    """The file's contents."""
    schemas: Json = openapi_document()["components"]["schemas"]
    texts: dict[str, str] = {}
    for name in (*NAMES, REQUEST[0]):
        _add(name, schemas, texts)
    command = [sys.executable, "-m", "ruff", "format", "-q", "--stdin-filename", str(FILE), "-"]
    text = f"{HEAD}\n" + "\n\n".join(texts.values())
    return subprocess.run(command, input=text, capture_output=True, text=True, check=True).stdout  # noqa: S603


def _add(name: str, schemas: Json, texts: dict[str, str]) -> None:
    """Add the type of a schema after those that it refers to."""
    named = _named(name)
    if named in texts:
        return
    texts[named] = ""  # reserves the name
    schema = schemas[name]
    left_out = REQUEST[2] if name == REQUEST[0] else frozenset()
    fields = {field: part for field, part in schema.get("properties", {}).items() if field not in left_out}
    for reference in _references(list(fields.values())):
        _add(reference, schemas, texts)
    del texts[named]
    if "enum" in schema:
        texts[named] = f"{named} = {_type(schema)}\n"
    else:
        texts[named] = _class(named, fields, set(schema.get("required", ())), schema.get("description", ""))


def _class(name: str, fields: Json, required: set[str], text: str) -> str:
    rows = [f"    {field}: {_type(part)}" for field, part in fields.items()]
    assert all(field.isidentifier() and not keyword.iskeyword(field) for field in fields)
    total = "" if set(fields) <= required else ", total=False"
    about = textwrap.fill(" ".join(text.split()), 110).replace("\n", "\n    ")
    help_text = [f'    """{about}"""', ""] if text else []
    return "\n".join([f"class {name}(TypedDict{total}):", *help_text, *rows, ""])


def _type(schema: Json) -> str:
    if "$ref" in schema:
        return _named(schema["$ref"].rpartition("/")[2])
    if "enum" in schema or "const" in schema:
        values = schema.get("enum", [schema.get("const")])
        return f"Literal[{', '.join(json.dumps(value) for value in values)}]"
    if parts := schema.get("anyOf", schema.get("oneOf")):
        return " | ".join(dict.fromkeys(_type(part) for part in parts))
    kind = schema.get("type", "")
    if kind == "array":
        if "prefixItems" in schema:
            return f"list[{' | '.join(dict.fromkeys(_type(part) for part in schema['prefixItems']))}]"
        return f"list[{_type(schema.get('items', {}))}]"
    if kind == "object":
        more = schema.get("additionalProperties", True)
        return f"dict[str, {_type(more) if isinstance(more, dict) else 'Any'}]"
    return PLAIN.get(kind, "Any")


def _references(part: object) -> Iterator[str]:
    """Names of the schemas that a part of the document refers to."""
    if isinstance(part, dict):
        if isinstance(part.get("$ref"), str):
            yield part["$ref"].rpartition("/")[2]
        part = list(part.values())
    if isinstance(part, list):
        for each in part:
            yield from _references(each)


def _named(schema: str) -> str:
    return REQUEST[1] if schema == REQUEST[0] else NAMES.get(schema, schema)


if __name__ == "__main__":
    FILE.write_text(document(), "utf-8")
