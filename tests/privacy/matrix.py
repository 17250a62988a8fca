"""The operations of the privacy matrix: every operation of the service, the objects that it names, and its scopes.

Operations come from the OpenAPI document (and routes beside it), objects from the names of path parameters and request
bodies. What is expected follows from rules: who calls, which scope the verb needs, and who owns the objects. The tables
below describe what cannot be derived; an operation with a parameter or body that no table has raises `Undescribed`.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from fastapi import FastAPI
from fastapi.routing import APIRoute

from tests.privacy.actors import one_shot

Ids = Mapping[str, str]
"""Kind of object -> id."""

OWNED = {
    "asset_id": "asset", "job_id": "job", "task_id": "task", "project_id": "project", "upload_id": "upload",
    "peer_id": "peer", "group_id": "group",
}  # fmt: skip
"""Path parameters that name an object of an owner."""
LINK = "token"
OPERATORS = frozenset({"key_id", "worker_id", "node", "attempt_id", "session_id", "owner_id", "rule_id"})
"""Path parameters of things that only operators see."""
PARTS = {"name": "svg", "entry": "a.svg", "index": "0", "version": "1", "user_id": "x"}
"""Path parameters that name a part of an owned object."""
PART_IDS = {"comment_id": "comment"}
"""Path parameters that name a part of an owned object by an id, which the callers have one of."""
LIBRARY = {"style_id": "swan", "input_name": "video", "name": "toy"}
"""Path parameters of what every key may see: methods, styles, scenes."""

SCOPES: dict[tuple[str, str], frozenset[str]] = {
    ("OPTIONS", "/v1/uploads"): frozenset(),  # limits of this server
    ("POST", "/v1/estimates"): frozenset({"read"}),  # computes, and stores nothing
    ("GET", "/v1/live"): frozenset({"submit"}),  # what a live session may ask for
    ("GET", "/v1/projects/{project_id}/previews/state"): frozenset({"submit"}),  # belongs to previews
    ("POST", "/v1/projects/{project_id}/share"): frozenset({"submit", "read"}),  # lets others read
    ("GET", "/v1/webhooks/secret"): frozenset({"submit"}),  # checks the messages of jobs that one submits
    ("POST", "/v1/live/whep"): frozenset({"read"}),  # watches
    ("GET", "/v1/me"): frozenset(),  # who the caller is
    ("DELETE", "/v1/live/peers/{peer_id}"): frozenset({"read"}),  # ends what whep began
}
"""Scopes of operations whose verb does not tell them."""
MEMBERS = "/v1/groups/{group_id}/members/{user_id}"
"""Changes of members, for which a group's owners are asked."""

_SHOT = {"shot": "s1"}
BODIES: dict[str, tuple[tuple[str, ...], Callable[[Ids], Any]]] = {
    "JobIn": (("asset",), lambda ids: {"method": "toy", "inputs": {"video": ids["asset"]}}),
    "PreviewIn": (
        ("asset", "job"),
        lambda ids: {"method": "toy", "inputs": {"video": ids["asset"]}, "artefacts_of": ids["job"]},
    ),
    "EstimateIn": (("project",), lambda ids: {"project": ids["project"]}),
    "FlickerIn": (("job",), lambda ids: {**_SHOT, "film": ids["job"]}),
    "ProjectIn": ((), lambda ids: {"document": one_shot(ids["asset"], "toy")}),
    "Document": ((), lambda ids: one_shot(ids["asset"], "toy")),
    "JobsActionIn": ((), lambda ids: {"action": "cancel", "jobs": [ids["job"]]}),
    "ExportIn": ((), lambda ids: {"format": "gif"}),
    "LabelIn": ((), lambda ids: {"label": "first"}),
    "CommentIn": ((), lambda ids: {"shot": "s1", "frame": 0, "text": "Too red."}),
    "ShareIn": ((), lambda ids: {}),
    "ProjectJobsIn": ((), lambda ids: {}),
    "KeyIn": ((), lambda ids: {"name": "k", "scopes": ["read"]}),
    "MemberIn": ((), lambda ids: {"role": "viewer"}),
    "OwnerIn": ((), lambda ids: {"kind": "group", "name": "g"}),
    "OwnerPatch": ((), lambda ids: {"name": "n"}),
    "TransferIn": ((), lambda ids: {"to": "x"}),
    "RuleIn": ((), lambda ids: {"days": 36500}),
    "ReasonIn": ((), lambda ids: {"reason": "r"}),
    "PriorityIn": ((), lambda ids: {"priority": 1}),
    "PropagateIn": ((), lambda ids: {**_SHOT, "key": 0}),
    "ObjectIn": ((), lambda ids: {**_SHOT, "box": [0.5, 0.5, 0.5, 0.5]}),
    "MatteIn": ((), lambda ids: {**_SHOT, "marks": [{"frame": 0, "box": [0.5, 0.5, 0.5, 0.5]}]}),
    "StylesIn": ((), lambda ids: {**_SHOT, "cards": [{"id": "c", "set": {}}]}),
    **dict.fromkeys(
        ("ClustersIn", "SpreadIn", "RegionsIn", "DirectionsIn", "KeysIn", "CutsIn", "PaintIn"),
        ((), lambda ids: _SHOT),
    ),
}
"""JSON bodies by schema: kinds of the objects that they name and that the caller must own, and a body."""
BECOMES_AN_INPUT = frozenset({"JobIn"})
"""Bodies whose assets become those of a job of the caller: an operator's job, too, uses only assets of the operator."""
RAW: dict[str, bytes] = {
    "multipart/form-data": (
        b'--b\r\nContent-Disposition: form-data; name="file"; filename="x.mp4"\r\n\r\nx\r\n--b--\r\n'
    ),
    "application/offset+octet-stream": b"12345678",
    "application/zip": b"PK",
    "application/json-patch+json": b"[]",
    "application/merge-patch+json": b"{}",
}
"""Bodies of other media types, which name no objects."""


class Undescribed(Exception):
    """An operation whose objects cannot be derived. Describe it in a table of this file."""


@dataclass(frozen=True)
class Operation:
    verb: str
    path: str
    media_type: str = ""
    schema: str = ""
    """Name of the schema of its JSON body."""

    @property
    def params(self) -> list[str]:
        return re.findall(r"{(\w+)(?::\w+)?}", self.path)

    @property
    def keyed(self) -> bool:
        """Whether it needs a key: everything does but links, health and pages."""
        return LINK not in self.params and (self.path.startswith("/v1/") or self.path == "/metrics")

    @property
    def scopes(self) -> frozenset[str]:
        if self.path.startswith(("/v1/ops/", "/v1/keys")):
            return frozenset({"admin"})
        return SCOPES.get(
            (self.verb, self.path), frozenset({"read" if self.verb in ("GET", "HEAD", "OPTIONS") else "submit"})
        )

    @property
    def in_library(self) -> bool:
        return self.path.startswith(("/v1/methods", "/v1/styles", "/v1/scenes"))

    @property
    def owned(self) -> list[str]:
        """Kinds of the objects that it names, in the address and in the body, and that belong to an owner."""
        for name in self.params:
            known = name in LIBRARY if self.in_library else {*OWNED, LINK, *OPERATORS, *PARTS, *PART_IDS}
            if known is False or (known is not True and name not in known):
                raise Undescribed(f"{self.verb} {self.path}: which kind of object is {name!r}?")
        named = [OWNED[name] for name in self.params if name in OWNED]
        return list(dict.fromkeys([*named, *self._body[0]]))

    @property
    def _body(self) -> tuple[tuple[str, ...], Callable[[Ids], Any] | None]:
        if not self.media_type or self.media_type in RAW:
            return (), None
        if self.schema not in BODIES:
            raise Undescribed(f"{self.verb} {self.path}: which objects does the body {self.schema!r} name?")
        return BODIES[self.schema]

    def url(self, ids: Ids) -> str:
        values = {
            **(LIBRARY if self.in_library else PARTS),
            **{name: ids.get(kind, "x") for name, kind in (*OWNED.items(), *PART_IDS.items())},
        }
        values |= {LINK: ids.get("link", "x"), **dict.fromkeys(OPERATORS, "x"), "key_id": ids.get("key", "x")}
        values |= {"user_id": ids.get("member", "x")}
        return re.sub(r"{(\w+)(?::\w+)?}", lambda found: values[found[1]], self.path)

    def content(self, ids: Ids) -> dict[str, Any]:
        """The body, as arguments of a request."""
        if self.media_type in RAW:
            kind = f"{self.media_type}; boundary=b" if self.media_type.startswith("multipart") else self.media_type
            return {"content": RAW[self.media_type], "headers": {"Content-Type": kind}}
        make = self._body[1]
        return {} if make is None else {"json": make(ids)}


def operations(app: FastAPI) -> list[Operation]:
    """Of the OpenAPI document, and the routes under /v1 that it leaves out."""
    found = list(_documented(app.openapi()))
    known = {(one.verb, one.path) for one in found}
    for route in app.routes:
        if isinstance(route, APIRoute) and route.path.startswith("/v1/"):
            plain = re.sub(r":\w+}", "}", route.path)
            found += [Operation(verb, plain) for verb in sorted(route.methods) if (verb, plain) not in known]
    return found


def _documented(document: Any) -> Iterator[Operation]:
    for path, item in document["paths"].items():
        for verb, row in item.items():
            content = row.get("requestBody", {}).get("content", {}) or {"": {}}
            for media_type, body in content.items():
                yield Operation(verb.upper(), path, media_type, _schema_name(body.get("schema", {})))


def _schema_name(schema: Any) -> str:
    options = [schema, *schema.get("anyOf", ())]
    names = [one["$ref"].rpartition("/")[2] for one in options if "$ref" in one]
    return names[0] if names else str(schema.get("title", ""))
