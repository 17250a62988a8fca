"""Random sequences of tus requests, compared with a model of the uploads (offsets and states of tus 1.0.0)."""

from __future__ import annotations

import asyncio
import base64
import hashlib
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from pipeline.methods.base import seeded
from tests.fuzz.asgi import Application, Header, Reply
from tests.fuzz.ledger import Run
from tests.fuzz.requests import verdict
from tests.fuzz.samples import samples
from tests.fuzz.service import application
from tests.fuzz.values import Random, changed_text, pick

STEP = 3000
"""Number of requests in a step, which has its own service."""
MOST_OPEN = 12
_TUS: Header = ("tus-resumable", "1.0.0")
_BODY: Header = ("content-type", "application/offset+octet-stream")
_HOSTILE = ("", "-1", "+1", "0x1", "1.0", "1e3", " 1", "9" * 18, "9" * 19, "\u00b2", "None")


@dataclass
class Upload:
    """Expected state of an upload. `content`: the bytes that its client will send."""

    id: str
    content: bytes
    offset: int = 0
    closed: bool = False
    """Whether all bytes have arrived: the upload is an asset, or was refused."""


class Client:
    """Sends one random request after another; `wrong` describes a deviation from the model, or is empty."""

    def __init__(self, app: Application, random: Random) -> None:
        self._app, self._random = app, random
        self._uploads: list[Upload] = []

    async def act(self) -> tuple[str, Reply]:
        """Send one request; the deviation from the model (empty: none), and the response."""
        acts = [self._create] if not self._uploads else [self._patch] * 4 + [self._head, self._hostile]
        if self._uploads and len(self._uploads) < MOST_OPEN:
            acts += [self._create]
        if len(self._uploads) >= MOST_OPEN // 2:
            acts += [self._delete]
        wrong, reply = await pick(self._random, acts)()
        return wrong or verdict(reply), reply

    async def _create(self) -> tuple[str, Reply]:
        kind = pick(self._random, ("png", "jpg", "noise", "noise", "empty"))
        noise = self._random.bytes(int(self._random.integers(1, 5000)))
        content = b"" if kind == "empty" else noise if kind == "noise" else samples()[kind][0]
        name = base64.b64encode(b"a." + kind.encode()).decode()
        headers = [_TUS, ("upload-length", str(len(content))), ("upload-metadata", f"filename {name}")]
        first = content[: int(self._random.integers(len(content) + 1))] if self._random.random() < 0.3 else b""
        if first:
            headers += [_BODY, ("content-length", str(len(first)))]
        reply = await self._app.request("POST", "/v1/uploads", headers, first)
        made = reply.headers.get("location", "").rpartition("/")[2]
        whole = len(first) == len(content)
        if reply.status == 201:
            self._uploads.append(Upload(made, content, len(first), whole))
            return self._offset_wrong(self._uploads[-1], reply), reply
        return ("" if whole and 400 <= reply.status < 500 else f"creation: {reply.status}"), reply

    async def _head(self) -> tuple[str, Reply]:
        upload = pick(self._random, self._uploads)
        reply = await self._app.request("HEAD", f"/v1/uploads/{upload.id}", [_TUS])
        if upload.closed and reply.status >= 400:  # refused media: the same problem each time
            return "", reply
        return (f"HEAD: {reply.status}" if reply.status != 200 else self._offset_wrong(upload, reply)), reply

    async def _patch(self) -> tuple[str, Reply]:
        upload = pick(self._random, self._uploads)
        begin, rest = upload.offset, len(upload.content) - upload.offset
        at = begin if self._random.random() < 0.7 else int(self._random.integers(len(upload.content) + 3))
        size = rest if self._random.random() < 0.4 else int(self._random.integers(rest + 1))
        body = upload.content[at : at + size] if at <= begin else b"x"
        headers = [_TUS, _BODY, ("upload-offset", str(at)), ("content-length", str(len(body)))]
        good = True
        if self._random.random() < 0.3:
            good = self._random.random() < 0.6
            digest = base64.b64encode(hashlib.sha256(body if good else body + b"!").digest()).decode()
            headers.append(("upload-checksum", f"sha256 {digest}"))
        reply = await self._app.request("PATCH", f"/v1/uploads/{upload.id}", headers, body)
        return self._patched(upload, at, len(body), good, reply), reply

    def _patched(self, upload: Upload, at: int, size: int, good: bool, reply: Reply) -> str:
        if upload.closed:
            return "" if reply.status < 500 else f"PATCH of a closed upload: {reply.status}"
        if at != upload.offset:
            return "" if reply.status == 409 else f"PATCH at {at} instead of {upload.offset}: {reply.status}"
        if not good:
            return "" if reply.status == 460 else f"PATCH with a wrong checksum: {reply.status}"
        upload.offset += size
        upload.closed = upload.offset == len(upload.content)
        if upload.closed and 400 <= reply.status < 500:
            return ""
        return f"PATCH: {reply.status}" if reply.status != 204 else self._offset_wrong(upload, reply)

    def _offset_wrong(self, upload: Upload, reply: Reply) -> str:
        said = reply.headers.get("upload-offset")
        return "" if said == str(upload.offset) else f"offset {said} instead of {upload.offset}"

    async def _hostile(self) -> tuple[str, Reply]:
        """Headers that no real client sends; they must not change the upload."""
        upload = pick(self._random, self._uploads)
        name = pick(self._random, ("upload-offset", "upload-length", "upload-checksum", "upload-metadata",
                                   "tus-resumable", "content-type", "content-length"))  # fmt: skip
        text = pick(self._random, _HOSTILE)
        plain = {"upload-checksum": "sha256 AAAA", "upload-metadata": "filename YQ=="}.get(name, "1.0.0")
        headers = [_TUS, _BODY, ("upload-offset", str(upload.offset + 1)), ("upload-length", "-")]
        headers = [(key, old) for key, old in headers if key != name]
        headers.append((name, text if self._random.random() < 0.5 else changed_text(plain, self._random)))
        if name == "upload-offset" and headers[-1][1] == str(upload.offset):
            headers[-1] = (name, "x")
        method, target = pick(self._random, (("PATCH", f"/{upload.id}"), ("POST", ""), ("HEAD", f"/{upload.id}")))
        body = b"hostile" if method == "PATCH" else b""
        reply = await self._app.request(method, f"/v1/uploads{target}", headers, body)
        if reply.status == 201:  # the length was one after all
            await self._app.request("DELETE", reply.headers["location"], [_TUS])
        return "", reply

    async def _delete(self) -> tuple[str, Reply]:
        upload = self._uploads.pop(int(self._random.integers(len(self._uploads))))
        reply = await self._app.request("DELETE", f"/v1/uploads/{upload.id}", [_TUS])
        gone = await self._app.request("HEAD", f"/v1/uploads/{upload.id}", [_TUS])
        return ("" if (reply.status, gone.status) == (204, 404) else f"DELETE: {reply.status}, {gone.status}"), reply


def fuzz(run: Run, folder: Path, goes_on: Callable[[], bool]) -> None:
    """Run steps until the time is up; a started step is finished."""
    while goes_on():
        number = run.first + run.steps
        asyncio.run(step(run, folder / f"tus-{number}", number))
        run.steps += 1


async def step(run: Run, folder: Path, number: int, requests: int = STEP) -> None:
    """One step: its requests depend on the seed and the number alone."""
    folder.mkdir()
    async with application(folder) as (app, _):
        client = Client(app, seeded(run.seed, 19, number))
        for index in range(requests):
            began = time.monotonic()
            wrong, reply = await client.act()
            run.count(f"{reply.status // 100}xx", time.monotonic() - began)
            if wrong:
                run.findings[f"tus:{run.seed}:{number}:{index}"] = wrong
