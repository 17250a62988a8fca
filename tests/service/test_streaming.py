"""Streamed responses: their resources are freed when the client disconnects, without a garbage collection."""

from __future__ import annotations

import gc
import socket
import threading
import time
from collections.abc import AsyncGenerator, Callable, Iterator
from contextlib import suppress
from pathlib import Path

import anyio
import anyio.to_thread
import httpx
import pytest
from starlette.types import Message

from pipeline.errors import Cancelled
from service.context.depends import DOWNLOADS
from service.settings import Settings
from service.streaming import StreamedResponse
from tests.service.driven_farm import MAGIC, DrivenFarm
from tests.service.live import running
from tests.service.records import records, types
from tests.waiting import until
from workers.contract.request import Json
from workers.farm import open_farm
from workers.farm_parts.stored_file import StoredFile
from workers.previews.memory import Check
from workers.previews.model import PreviewQuery, Record
from workers.previews.service import PreviewRun, PreviewService

SLOTS = 2
THREADS = 40
"""Number of requests that a service handles at once, each in a thread."""
SMALL_BUFFER = socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 16
"""Socket option of a client that does not read: Linux would otherwise receive up to 32 MiB for it."""
LAST = 9
"""The frame whose preview is ready at once."""


@pytest.fixture(autouse=True)
def no_garbage_collection() -> Iterator[None]:
    gc.disable()
    yield
    gc.enable()


class EndlessRunner:
    """Begins a response and then works until the client disconnects."""

    def __init__(self) -> None:
        self.cancelled: list[int] = []

    def start(self) -> None: ...

    def run(self, query: PreviewQuery, check: Check) -> Iterator[Record]:
        yield Record({"type": "begin", "seq": query.seq})
        while query.options["frame"] != LAST:
            try:
                check()
            except Cancelled:
                self.cancelled.append(query.options["frame"])
                raise
            time.sleep(0.01)
        yield Record({"type": "end", "ms": 1})

    def state(self) -> Json:
        return {}

    def close(self) -> None: ...


class CountedPreviews(PreviewService):
    """Counts the queries that have begun."""

    begun = 0

    def start(self, query: PreviewQuery, owner: str = "") -> PreviewRun:
        self.begun += 1
        return super().start(query, owner)


def test_a_preview_that_its_client_leaves_frees_its_slot(
    home: Path, tiny_clip: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings = Settings(home=home, pool="none")
    farm, runner = open_farm(settings), EndlessRunner()
    monkeypatch.setattr(farm, "previews", PreviewService(runner, SLOTS))
    with running(settings, farm) as url, httpx.Client(base_url=url, timeout=60) as http:
        paint = f"{_project(http, tiny_clip)}/previews/paint"
        for frame in range(SLOTS + 1):
            body = {"shot": "s1", "client": f"tab-{frame}", "frame": frame}
            with httpx.Client(base_url=url, timeout=60) as tab, tab.stream("POST", paint, json=body) as answer:
                assert next(answer.iter_raw())
        last = http.post(paint, json={"shot": "s1", "client": "another", "frame": LAST})
        assert types(records(last.content)) == ["begin", "end"]
        until(lambda: len(runner.cancelled) == SLOTS + 1)
    farm.stop()


def test_previews_that_wait_for_a_slot_block_no_other_request(
    home: Path, tiny_clip: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings = Settings(home=home, pool="none")
    farm, previews = open_farm(settings), CountedPreviews(EndlessRunner(), SLOTS)
    monkeypatch.setattr(farm, "previews", previews)
    with running(settings, farm) as url, httpx.Client(base_url=url, timeout=20) as http:
        paint = f"{_project(http, tiny_clip)}/previews/paint"

        async def ask(tab: httpx.AsyncClient, number: int) -> None:
            body = {"shot": "s1", "client": f"tab-{number}", "frame": 0}
            await tab.post(paint, json=body)

        async def main() -> None:
            async with httpx.AsyncClient(base_url=url, timeout=600) as tab, anyio.create_task_group() as group:
                for number in range(THREADS + SLOTS):
                    group.start_soon(ask, tab, number)
                await anyio.to_thread.run_sync(until, lambda: previews.begun >= THREADS)
                answer = await anyio.to_thread.run_sync(http.get, "/v1/projects")
                assert answer.is_success
                group.cancel_scope.cancel()

        anyio.run(main)
        last = http.post(paint, json={"shot": "s1", "client": "another", "frame": LAST})
        assert types(records(last.content)) == ["begin", "end"]
    farm.stop()


def _project(http: httpx.Client, clip: Path) -> str:
    video = http.post("/v1/assets", files={"file": (clip.name, clip.read_bytes())}).json()["id"]
    shot = {"id": "s1", "video": "clip", "layers": [{"id": "l1", "method": "multistyle"}]}
    document = {"schema": 2, "name": "Swan", "assets": {"clip": {"id": video}}, "shots": [shot]}
    return str(http.post("/v1/projects", json={"document": document}).json()["links"]["self"])


def test_a_download_that_its_client_leaves_closes_its_file(settings: Settings, farm: DrivenFarm, home: Path) -> None:
    with running(settings, farm) as url, httpx.Client(base_url=url, timeout=60) as http:
        asset = http.post("/v1/assets", files={"file": ("long.mp4", MAGIC + bytes(32 << 20))}).json()
        with (
            httpx.Client(base_url=url, timeout=60, transport=httpx.HTTPTransport(socket_options=[SMALL_BUFFER])) as tab,
            tab.stream("GET", f"/v1/assets/{asset['id']}/content") as answer,
        ):
            pieces = answer.iter_raw()  # kept, since the answer ends with it
            assert next(pieces)
            until(lambda: _open_below(home / "blobs"))
        until(lambda: not _open_below(home / "blobs"))


def test_downloads_from_a_slow_store_block_no_other_request(
    settings: Settings, farm: DrivenFarm, monkeypatch: pytest.MonkeyPatch
) -> None:
    answers = threading.Event()
    read, begun = farm.files.read, list[StoredFile]()

    def slowly(file: StoredFile, start: int = 0, stop: int | None = None) -> Iterator[bytes]:
        begun.append(file)
        answers.wait(60)
        yield from read(file, start, stop)

    monkeypatch.setattr(farm.files, "read", slowly)
    with running(settings, farm) as url, httpx.Client(base_url=url, timeout=20) as http:
        asset = http.post("/v1/assets", files={"file": ("clip.mp4", MAGIC + bytes(1000))}).json()
        received: list[int] = []

        async def download(tab: httpx.AsyncClient) -> None:
            received.append(len((await tab.get(f"/v1/assets/{asset['id']}/content")).content))

        async def main() -> None:
            limits = httpx.Limits(max_connections=2 * THREADS)
            async with (
                httpx.AsyncClient(base_url=url, timeout=60, limits=limits) as tab,
                anyio.create_task_group() as group,
            ):
                for _ in range(THREADS + 4):
                    group.start_soon(download, tab)
                await anyio.to_thread.run_sync(until, lambda: len(begun) >= DOWNLOADS)
                answer = await anyio.to_thread.run_sync(http.get, f"/v1/assets/{asset['id']}")
                assert answer.is_success
                answers.set()

        anyio.run(main)
        assert received == [len(MAGIC) + 1000] * (THREADS + 4)


def _open_below(folder: Path) -> list[str]:
    """Files in `folder` that this process has open."""
    found = []
    for descriptor in Path("/proc/self/fd").iterdir():
        with suppress(OSError):  # closed meanwhile
            found.append(str(descriptor.readlink()))
    return [name for name in found if name.startswith(f"{folder}/")]


async def _pieces(closed: Callable[[], None]) -> AsyncGenerator[str]:
    try:
        while True:
            yield "more"
    finally:
        closed()


def _pieces_in_threads(closed: Callable[[], None]) -> Iterator[bytes]:
    try:
        while True:
            yield b"more"
    finally:
        closed()


@pytest.mark.parametrize("pieces", [_pieces, _pieces_in_threads])
def test_a_source_is_closed_while_its_client_does_not_read(
    pieces: Callable[[Callable[[], None]], AsyncGenerator[str] | Iterator[bytes]],
) -> None:
    heard: list[str] = []
    source = pieces(lambda: heard.append("closed"))
    response = StreamedResponse(source, 200, {}, "text/plain", lambda: heard.append("left"))

    async def answer() -> None:
        sending = anyio.Event()

        async def receive() -> Message:
            await sending.wait()
            return {"type": "http.disconnect"}

        async def send(message: Message) -> None:
            if message["type"] == "http.response.body":
                sending.set()
                await anyio.sleep_forever()

        await response({"type": "http", "asgi": {"spec_version": "2.3"}}, receive, send)

    anyio.run(answer)
    assert heard == ["left", "closed"]
