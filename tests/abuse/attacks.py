"""The attacks: of every route of the OpenAPI document, and those that are known to have worked."""

from __future__ import annotations

import asyncio
import io
import json
import struct
import zipfile
from collections.abc import Callable, Iterable, Iterator
from typing import Any
from urllib.parse import quote

from aiortc import RTCPeerConnection

from service.app import openapi_document
from tests.abuse.attack import Attack, Call
from tests.abuse.target import Target, noise
from tests.fuzz.service import document

Json = dict[str, Any]
CONTROL = "nothing"
PARALLEL = 45
ANY_VERSION = "If-Match: *\r\n"
COPY: Json = {"op": "copy", "from": "/ui/a", "path": "/ui/a/-"}
NEST: Json = {"op": "copy", "from": "/ui", "path": "/ui/o/k"}
FRONT: Json = {"op": "add", "path": "/ui/a/0", "value": [0] * 200}
JSON, PATCH, MERGE = "application/json", "application/json-patch+json", "application/merge-patch+json"
MIB = 1 << 20
_LEFT_OUT = ("/v1/keys", "/metrics")
_NOT_MINE = ("/queue",)
"""Ends of paths with known costs of their own, measured by the cost harness."""


def attack_of(name: str, made: Target) -> Attack:
    """The attack of that name on a service."""
    calls, parallel, slow_s = ATTACKS[name]
    return Attack(name, tuple(calls(made)), parallel, slow_s, 1e9 if slow_s else 8.0)


def _bodies(body: Callable[[], bytes]) -> Callable[[Target], Iterator[Call]]:
    """A body for every route that has one."""
    return lambda made: _calls(made, [route for route in _routes(made) if route[2]], body())


def _patches(*operations: Json) -> Callable[[Target], Iterator[Call]]:
    def calls(made: Target) -> Iterator[Call]:
        yield _call(made, "PATCH", _grown(made), PATCH, json.dumps(operations).encode(), ANY_VERSION)

    return calls


def _previews(made: Target) -> Iterator[Call]:
    body = json.dumps({"change": [COPY] * 24, "shot": "s1"}).encode()
    yield _call(made, "POST", f"{_grown(made)}/previews/paint", JSON, body)


def _saves(made: Target) -> Iterator[Call]:
    for number in range(3):
        value = {**document(made.facts["asset"]), "ui": {"n": noise(number, 3_800_000)}}
        yield _call(made, "PUT", _grown(made), JSON, json.dumps(value).encode(), ANY_VERSION)


def _many(end: str) -> Callable[[Target], Iterator[Call]]:
    return lambda made: iter([_call(made, "GET", f"/v1/projects/{made.facts['many']}{end}")])


def _imports(made: Target) -> Iterator[Call]:
    for bomb in _zips():
        yield _call(made, "POST", "/v1/projects/import", "application/zip", bomb)


def _whip(made: Target) -> Iterator[Call]:
    offer = asyncio.run(_offer())
    for query in ("method=abstraction", "params=" + "[" * 3000):
        yield _call(made, "POST", f"/v1/live/whip?{query}", "application/sdp", offer)


def _forms(made: Target) -> Iterator[Call]:
    parts = b'--x\r\nContent-Disposition: form-data; name="file"; filename="a"\r\n' + b"X: y\r\n" * 5000
    yield _call(made, "POST", "/v1/assets", "multipart/form-data; boundary=x", parts + b"a" * MIB)


def _grown(made: Target) -> str:
    return f"/v1/projects/{made.facts['grown']}"


def _routes(made: Target) -> Iterator[tuple[str, str, bool]]:
    """(method, path, whether it has a body) of every route of a user."""
    for path, methods in openapi_document()["paths"].items():
        if path.startswith(_LEFT_OUT) or path.endswith((*_NOT_MINE, "/events")):
            continue
        for name, value in made.known.items():
            path = path.replace(f"{{{name}}}", value)
        for method in methods:
            if method.upper() != "DELETE":
                yield method.upper(), path, method in ("post", "put", "patch")


def _calls(made: Target, routes: list[tuple[str, str, bool]], body: bytes) -> Iterator[Call]:
    for method, path, has_body in routes:
        kind = MERGE if method == "PATCH" and "/projects/" in path else JSON
        match = "If-Match: *\r\n" if "/projects/" in path else ""
        yield _call(made, method, path, kind, body if has_body else b"", match)


def _queries(made: Target, routes: list[tuple[str, str, bool]]) -> Iterator[Call]:
    names = ("cursor", "limit", "label", "search", "state", "params", "index", "seed", "version")
    for method, path, has_body in routes:
        for text in ("[" * 3000, "9" * 3000, quote('{"a":' * 500)):
            query = "&".join(f"{name}={text}" for name in names)
            yield _call(made, method, f"{path}?{query}", JSON, b"{}" if has_body else b"")


def _call(made: Target, method: str, path: str, kind: str = JSON, body: bytes = b"", more: str = "") -> Call:
    head = f"{method} {path} HTTP/1.1\r\nHost: {made.place[0]}\r\nAuthorization: Bearer {made.keys[0]}\r\n{more}"
    return Call((head + (f"Content-Type: {kind}\r\n" if body else "")).encode(), body)


def _text(size: int) -> bytes:
    return b'{"name":"' + b"x" * size + b'"}'


def _lists(size: int) -> bytes:
    return b'{"a":[' + b"[]," * (size // 3) + b"[]]}"


def _members(size: int) -> bytes:
    return json.dumps({f"k{n}": 0 for n in range(size // 13)}).encode()


def _deep(depth: int, count: int) -> bytes:
    one = b"[" * (depth - 2) + b"]" * (depth - 2)
    return b'{"a":[' + b",".join([one] * count) + b"]}"


def _zips() -> Iterator[bytes]:
    for method in (zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA):
        large, stream = b" " * (100 * MIB), io.BytesIO()
        with zipfile.ZipFile(stream, "w", method) as archive:
            archive.writestr("project.json", large)
        yield stream.getvalue().replace(struct.pack("<L", len(large)), struct.pack("<L", 1 << 20))
    entry = struct.pack("<4s4B4H3L5H2L", b"PK\x01\x02", 20, 3, 20, *[0] * 8, 1, *[0] * 6) + b"a"
    directory = entry * 300_000
    yield directory + struct.pack("<4s4H2LH", b"PK\x05\x06", 0, 0, 65535, 65535, len(directory), 0, 0)


async def _offer() -> bytes:
    peer = RTCPeerConnection()
    peer.addTransceiver("video")
    await peer.setLocalDescription(await peer.createOffer())
    text: Any = peer.localDescription.sdp
    await peer.close()
    return str(text).encode()


ATTACKS: dict[str, tuple[Callable[[Target], Iterable[Call]], int, float]] = {
    CONTROL: (lambda made: iter(()), 0, 0),
    "most parallel: every route": (lambda made: _calls(made, list(_routes(made)), b"{}"), PARALLEL, 0),
    "largest: 30 MiB of text": (_bodies(lambda: _text(30 * MIB)), 8, 0),
    "largest: 1 MiB of text": (_bodies(lambda: _text(MIB - 64)), PARALLEL, 0),
    "most values: 30 MiB of []": (_bodies(lambda: _lists(30 * MIB)), 8, 0),
    "most values: 1 MiB of []": (_bodies(lambda: _lists(MIB - 64)), PARALLEL, 0),
    "most members: 1 MiB": (_bodies(lambda: _members(MIB - 64)), PARALLEL, 0),
    "deepest: 64 levels, many": (_bodies(lambda: _deep(64, 4000)), PARALLEL, 0),
    "deepest: 500,000 levels": (_bodies(lambda: b"[" * 500_000), PARALLEL, 0),
    "deepest and longest queries": (lambda made: _queries(made, list(_routes(made))), PARALLEL, 0),
    "slowest: a byte in two seconds": (_bodies(lambda: b" " * 500), 200, 2.0),
    "patch: copies": (_patches(*[COPY] * 24), 8, 0),
    "patch: copies that nest": (_patches(*[NEST] * 60), 8, 0),
    "patch: inserts at the front": (_patches(*[FRONT] * 1000), 8, 0),
    "preview: copies in `change`": (_previews, 8, 0),
    "documents: saves of 4 MB": (_saves, 8, 0),
    "documents: read 1.7 MB": (_many(""), PARALLEL, 0),
    "19,000 assets: check": (_many("/check"), PARALLEL, 0),
    "19,000 assets: export": (_many("/export"), PARALLEL, 0),
    "import: zip bombs": (_imports, 8, 0),
    "WebRTC: offers": (_whip, PARALLEL, 0),
    "multipart: many headers": (_forms, PARALLEL, 0),
}
"""Name -> requests, connections at once, pause between two bytes of a body in seconds. The last ones have once worked,
or are described by no schema."""
