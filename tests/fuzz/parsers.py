"""Randomly changed texts of clients, passed to the functions that parse them: accepted, or refused with our error."""

from __future__ import annotations

import json
import time
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from starlette.datastructures import Headers

from pipeline.errors import ImpastoError
from pipeline.methods import methods, parse_params
from pipeline.methods.base import seeded
from pipeline.video.guard import wire
from service.access.gate import _bearer
from service.assets.multipart import FileReceiver
from service.live.frames import Header as FrameHeader
from service.live.frames import pack, unpack
from service.live.messages import parse
from service.projects.tokens import Claims, sign, verify
from service.serving import disposition, wanted
from service.uploads.headers import Checksum, filename, whole_number
from service.webhooks.targets import is_public
from tests.fuzz.ledger import Run
from tests.fuzz.mutate import mutated
from tests.fuzz.service import document
from tests.fuzz.values import Random, changed_json, changed_text
from workers.blobs.keys import check_key
from workers.filenames import check_filename
from workers.projects.parsing import parse_document
from workers.projects.patching import merged, patched
from workers.store.records import unpack_cursor
from workers.strict_json import strict_json

STEP = 200
"""Number of cases of every parser in a step."""
_REFUSALS = (ImpastoError, wire.ConnectionBroken)
_LENGTH = "upload-length"
_SECRET = b"secret of the test"
_FORM = b'--x\r\nContent-Disposition: form-data; name="file"; filename="a.mp4"\r\n\r\nabc\r\n--x--\r\n'
_HELLO = {"type": "hello", "width": 64, "height": 64, "fps": 25, "send": ["vp8"], "params": {"a": 1}, "inputs": {}}
_PATCH = [
    {"op": "add", "path": "/shots/0/layers/0/params", "value": {"relief": 2}},
    {"op": "replace", "path": "/name", "value": "Duck"},
]


class Parser(NamedTuple):
    """A parsing function and a well-formed sample of its input: text, bytes, or JSON."""

    name: str
    sample: Any
    read: Callable[[Any], object]


def parsers(folder: Path) -> Iterator[Parser]:
    """Every parser. `folder`: for files that are received."""
    plain = document("ast_" + "a" * 64)

    def form(data: bytes) -> None:
        receiver = FileReceiver("multipart/form-data; boundary=x", folder / "form")
        try:
            receiver.feed(data)
            receiver.finish()
        finally:
            receiver.close()

    yield Parser("JSON body", json.dumps(plain).encode(), strict_json)
    yield Parser("live message", json.dumps(_HELLO), parse)
    yield Parser("live frame", pack(FrameHeader(True, 64, 48, 7, 2**40), b"data"), unpack)
    yield Parser("message of a decoder", wire.packed({"size": [1, 2]}, b"data"), _wire)
    yield Parser("form", _FORM, form)
    yield Parser(
        "form's type", "multipart/form-data; boundary=x", lambda text: FileReceiver(_header(text), folder / "form")
    )
    yield Parser("range", "bytes=3-9", lambda text: wanted(_headers("range", text), 100, '"a"'))
    yield Parser("upload metadata", "filename YS5tcDQ=,empty", lambda text: filename(_header(text)))
    yield Parser("upload checksum", "sha256 AAAA", lambda text: Checksum.of(_headers("upload-checksum", text)))
    yield Parser("upload length", "123", lambda text: whole_number(_headers("upload-length", text), "upload-length"))
    yield Parser("file name", "clip.mp4", lambda text: disposition(check_filename(text), True))
    yield Parser("key", "Bearer imp_0123456789", lambda text: _bearer(_headers("authorization", text)))
    yield Parser("token", sign(Claims("prj_1", "key_1", 1, 2**40), _SECRET), lambda text: verify(text, _SECRET, 0.0))
    yield Parser("cursor", "WzFd", lambda text: unpack_cursor(text, int))
    yield Parser("blob key", "jobs/job_1/att_1/segment", check_key)
    yield Parser("address", "64:ff9b::7f00:1", _address)
    yield Parser("project", plain, parse_document)
    yield Parser("JSON Patch", _PATCH, lambda value: parse_document(patched(plain, value)))
    yield Parser("merge patch", {"name": "Duck", "shots": []}, lambda value: parse_document(merged(plain, value)))
    for name, method in sorted(methods().items()):
        values = method.Params().model_dump(mode="json")
        yield Parser(f"parameters of {name}", values, lambda value, method=method: parse_params(method, value))  # type: ignore[misc]


def _header(text: str) -> str:
    """The text as the server reads it from a header: characters of Latin-1."""
    return text.encode("latin-1", "replace").decode("latin-1")


def _headers(name: str, text: str) -> Headers:
    return Headers({name: _header(text)})


def _wire(data: bytes) -> object:
    text_bytes, data_bytes = wire.lengths(data[: wire.HEADER.size].ljust(wire.HEADER.size, b"\0"))
    return wire.parsed(data[wire.HEADER.size :][:text_bytes]), data_bytes


def _address(text: str) -> bool:
    try:
        return is_public(text)
    except ValueError:  # the system's resolver gives addresses only
        return False


def fuzz(run: Run, folder: Path, goes_on: Callable[[], bool]) -> None:
    """Run steps until the time is up."""
    found = list(parsers(folder))
    while goes_on():
        step(run, found, run.first + run.steps)
        run.steps += 1


def step(run: Run, found: list[Parser], number: int, cases: int = STEP) -> None:
    """One step: `cases` changed samples for each parser."""
    for index, parser in enumerate(found):
        random = seeded(run.seed, 29, number, index)
        for case in range(cases):
            value = changed(parser.sample, random)
            began = time.monotonic()
            what = outcome(parser, value)
            run.count(what.partition(":")[0], time.monotonic() - began)
            if what.startswith("fault"):
                run.findings[f"parsers:{parser.name}:{run.seed}:{number}:{case}"] = f"{what}: {value!r}"[:500]


def changed(sample: Any, random: Random) -> Any:
    """A sample with some changes; its type stays, except for JSON."""
    if isinstance(sample, bytes):
        return mutated(sample, sample, int(random.integers(2**31)), 0)
    if isinstance(sample, str):
        text = sample
        for _ in range(int(random.integers(1, 4))):
            text = changed_text(text, random)
        return text
    value = changed_json(sample, random, 4)
    return value if isinstance(value, type(sample)) else sample


def outcome(parser: Parser, value: Any) -> str:
    """The outcome of a case: "read", "refused", or "fault: ERROR" for any exception except a refusal."""
    try:
        parser.read(value)
    except _REFUSALS:
        return "refused"
    except Exception as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        return f"fault: {type(error).__name__}: {error} ({Path(where.filename).name}:{where.lineno})"
    return "read"
