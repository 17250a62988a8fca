"""Writes the reference of the HTTP API as Markdown, from the service's OpenAPI document."""

from __future__ import annotations

import json
from collections.abc import Iterator

from service.app import openapi_document
from workers.contract.request import Json


def http_reference() -> str:
    """A page with all operations (parameters, body, responses) and all schemas."""
    document = openapi_document()
    return "\n".join(_lines(document))


def _lines(document: Json) -> Iterator[str]:
    yield "# HTTP reference\n"
    yield "Generated from the OpenAPI document of the service. [The HTTP API](api.md) explains it with examples.\n"
    for tag in document["tags"]:
        yield f"## {tag['name'].capitalize()}\n\n{tag['description']}\n"
        for path, item in document["paths"].items():
            for verb, operation in item.items():
                if tag["name"] in operation["tags"]:
                    yield from _operation(verb, path, operation)
    yield "## Schemas\n"
    for name, schema in document["components"]["schemas"].items():
        yield from _schema(name, schema)


def _operation(verb: str, path: str, operation: Json) -> Iterator[str]:
    yield f"### `{verb.upper()} {path}`\n\n{operation['description']}\n"
    rows = [
        f"| `{given['name']}` | {given['in']} | {_type(given['schema'])} | {_cell(given.get('description', ''))} |"
        for given in operation.get("parameters", ())
    ]
    if rows:
        yield "\n".join(["| parameter | in | type | |", "|---|---|---|---|", *rows]) + "\n"
    for media_type, content in operation.get("requestBody", {}).get("content", {}).items():
        yield f"Body: `{media_type}`, {_type(content.get('schema', {}))}.\n"
    for status, answer in operation["responses"].items():
        if status not in ("4XX", "5XX"):
            types = [_type(content.get("schema", {})) for content in answer.get("content", {}).values()]
            yield f"- {status}: {_cell(answer['description'])}{', ' + ' or '.join(types) if types else ''}"
    yield ""


def _schema(name: str, schema: Json) -> Iterator[str]:
    yield f"### {name}\n\n{schema.get('description', '')}\n"
    if "enum" in schema:
        yield "One of " + ", ".join(f"`{value}`" for value in schema["enum"]) + ".\n"
    required = set(schema.get("required", ()))
    rows = [
        f"| `{field}` | {_type(part)} | {'yes' if field in required else ''} | {_cell(part.get('description', ''))} |"
        for field, part in schema.get("properties", {}).items()
    ]
    if rows:
        yield "\n".join(["| field | type | required | |", "|---|---|---|---|", *rows]) + "\n"
    for example in schema.get("examples", ()):
        yield f"```json\n{json.dumps(example, indent=2)}\n```\n"


def _type(schema: Json) -> str:
    """A schema in a few words; a named one as a link to its section."""
    if "$ref" in schema:
        name = schema["$ref"].rpartition("/")[2]
        return f"[{name}](#{name.lower()})"
    if "anyOf" in schema:
        return " or ".join(_type(part) for part in schema["anyOf"])
    if schema.get("type") == "array":
        return f"list of {_type(schema.get('items', {}))}"
    if "enum" in schema:
        return ", ".join(f"`{value}`" for value in schema["enum"])
    return str(schema.get("format", schema.get("type", "any")))


def _cell(text: str) -> str:
    return text.replace("\n", " ").replace("|", "\\|")
