"""The OpenAPI document of the service, as clients are generated from it.

FastAPI writes the document from the routes. `complete` adds what generators of clients need: a unique title for each
schema, the problem's schema, tags, servers, examples, and which fields an answer always has.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import cast

from fastapi import FastAPI

from service.errors import Problem
from workers.contract.request import Json
from workers.projects.document import json_schema

TITLE = "Impasto"
SUMMARY = "Turn video into paintings and cartoons that hold still where they should."
DESCRIPTION = """\
Upload a video (`POST /v1/assets`), submit a job (`POST /v1/jobs`), follow its events
(`GET /v1/jobs/{job_id}/events`) and download the result (`GET /v1/jobs/{job_id}/result`).

- Times are seconds since 1970-01-01 UTC.
- Lists are pages of `limit` items; `cursor` of a page requests the next one, and `null` marks the last.
- Every failure is a problem document (RFC 9457) with a stable `code`, the `field` that is wrong, and a `remedy`.
- Requests carry an API key as bearer token. A service that listens on this machine only needs none by default.
"""
SERVERS = [
    {"url": "/", "description": "The service that this document comes from"},
    {"url": "http://127.0.0.1:8420", "description": "`impasto serve` on this machine, with its default address"},
]
TAGS = {
    "methods": "Methods, with the JSON Schema of their parameters and inputs.",
    "assets": "Uploaded files: videos, images, zips and JSON documents.",
    "uploads": "Resumable uploads of large files (tus 1.0.0).",
    "jobs": "Jobs: submit, list, cancel, pause, resume, retry, delete.",
    "tasks": "Tasks of a job, with their attempts and logs.",
    "events": "What happens to a job, as Server-Sent Events.",
    "files": "Files of a job: result, poster, contact sheet, artefacts.",
    "webhooks": "Messages to a URL of yours when a job ends.",
    "previews": "Single frames, stylised at once.",
    "artefacts": "Entries of artefacts that are zip files.",
    "styles": "Paintings of the style library, which every user may choose.",
    "projects": "Projects of the studio: documents with versions, previews, estimates and jobs.",
    "live": "Live sessions. The WebSocket itself is described in docs/live.md.",
    "users": "Who the caller is, and the members of groups.",
    "ops": "For operators: health, metrics, queue, workers, machines, keys, users, audit trail, costs.",
}
_GENERIC = re.compile(r"^Listing_(\w+)_$")


def install(app: FastAPI) -> None:
    """Make the app answer with the completed document."""
    plain = app.openapi

    def openapi() -> Json:
        if app.openapi_schema is None:
            app.openapi_schema = complete(plain())
        return app.openapi_schema

    app.openapi = openapi  # type: ignore[method-assign]


def complete(document: Json) -> Json:
    """The document, completed. `document` itself may be changed."""
    from service.openapi_examples import EXAMPLES  # here, because they load a method

    schemas = document.setdefault("components", {}).setdefault("schemas", {})
    schemas.update(_problem_schemas())
    document = cast(Json, _renamed(document, _new_names(schemas)))
    schemas = document["components"]["schemas"]
    for name, schema in schemas.items():
        schema["title"] = name
        if name in EXAMPLES:
            schema["examples"] = list(EXAMPLES[name])
    for name in schemas.keys() - _reached(document, _request_bodies(document)) - {"Problem"}:
        if "properties" in schemas[name]:
            schemas[name]["required"] = list(schemas[name]["properties"])  # an answer has every field
    document["servers"] = SERVERS
    document["tags"] = [{"name": name, "description": text} for name, text in TAGS.items()]
    return document


def with_projects(document: Json) -> Json:
    """The document with the schemas of a project and its parts (`ProjectDocument`, `ProjectLayer`, ...), from which the
    types of the pages are made. `document` is changed."""
    project = json.loads(json.dumps(json_schema()).replace("#/$defs/", "#/components/schemas/Project"))
    parts = project.pop("$defs") | {"Document": project}
    document["components"]["schemas"] |= {f"Project{name}": part for name, part in parts.items()}
    return document


def _problem_schemas() -> dict[str, Json]:
    schema = Problem.model_json_schema(ref_template="#/components/schemas/{model}")
    return {**schema.pop("$defs"), "Problem": schema}


def _new_names(schemas: Json) -> dict[str, str]:
    """`Listing_JobOut_`, as FastAPI names `Listing[JobOut]`, becomes `JobOutList`."""
    found = {name: _GENERIC.match(name) for name in schemas}
    return {name: f"{match[1]}List" for name, match in found.items() if match}


def _renamed(part: object, names: dict[str, str]) -> object:
    """The part with its schemas, and references to them, under their new names."""
    if isinstance(part, dict):
        return {names.get(key, key): _renamed(value, names) for key, value in part.items()}
    if isinstance(part, list):
        return [_renamed(item, names) for item in part]
    if isinstance(part, str) and part.startswith("#/components/schemas/"):
        place, _, name = part.rpartition("/")
        return f"{place}/{names.get(name, name)}"
    return part


def _request_bodies(document: Json) -> list[object]:
    return [row["requestBody"] for item in document["paths"].values() for row in item.values() if "requestBody" in row]


def _reached(document: Json, parts: list[object]) -> set[str]:
    """Names of the schemas to which the parts refer, directly or through other schemas."""
    found: set[str] = set()
    waiting = parts
    while waiting:
        names = {name for part in waiting for name in _references(part)} - found
        found |= names
        waiting = [document["components"]["schemas"][name] for name in names]
    return found


def _references(part: object) -> Iterator[str]:
    if isinstance(part, dict):
        if isinstance(reference := part.get("$ref"), str):
            yield reference.rpartition("/")[2]
        for value in part.values():
            yield from _references(value)
    elif isinstance(part, list):
        for item in part:
            yield from _references(item)
