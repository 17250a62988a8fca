"""Mixed load on a service: jobs of every method, live sessions, resumable uploads, and pages that poll."""

from __future__ import annotations

import asyncio
import json
import random
import threading
import time
from collections import Counter
from collections.abc import Callable
from typing import Any

import httpx
from websockets.asyncio.client import ClientConnection, connect

from tests.fuzz.samples import SIZE, samples
from tests.service.live_client import pack

_FINAL = ("succeeded", "failed", "cancelled")
_PAGES = (
    "/",
    "/ops",
    "/live",
    "/docs",
    "/v1/jobs?limit=50",
    "/v1/methods",
    "/metrics",
    "/v1/ops/queue",
    "/v1/ops/check",
)
_POLL_S = 0.5
_LIVE_FRAMES = 40


class Load:
    """Threads that ask a service until `stop`.

    Each of four threads has one kind of work; it waits `pause_s` seconds between two pieces of work.

    Attributes:
        done: what has been done, by kind: jobs by method and final state, uploads, live frames, polls; "fault: ..." for
            answers of 500 and more and for lost connections.
    """

    def __init__(self, url: str, seed: int, pause_s: float = 0.0) -> None:
        self._url = url
        self._pause_s = pause_s
        self._chance = random.Random(seed)
        self._over = threading.Event()
        self.done: Counter[str] = Counter()
        works = (self._jobs, self._live, self._uploads, self._poll)
        self._threads = [threading.Thread(target=self._repeat, args=(work,), daemon=True) for work in works]

    def start(self) -> None:
        for thread in self._threads:
            thread.start()

    def stop(self) -> None:
        self._over.set()
        for thread in self._threads:
            thread.join(120)

    def _repeat(self, work: Callable[[httpx.Client], None]) -> None:
        with httpx.Client(base_url=self._url, timeout=120) as client:
            while not self._over.is_set():
                try:
                    work(client)
                except Exception as error:
                    self.done[f"fault: {work.__name__}: {type(error).__name__}: {error}"[:120]] += 1
                    self._over.wait(1.0)
                self._over.wait(self._pause_s)

    def _ask(self, client: httpx.Client, method: str, path: str, **more: Any) -> httpx.Response:
        answer = client.request(method, path, **more)
        if answer.status_code >= 500:
            self.done[f"fault: {method} {path.partition('?')[0]}: {answer.status_code}"] += 1
        return answer

    def _asset(self, client: httpx.Client, kind: str) -> str:
        file = (f"clip.{kind}", samples()[kind][0])
        return str(self._ask(client, "POST", "/v1/assets", files={"file": file}).json()["id"])

    def _jobs(self, client: httpx.Client) -> None:
        """A job of each method, one after another; each is deleted once it has ended."""
        kinds = {"video": "mp4", "image": "png"}
        for method in self._ask(client, "GET", "/v1/methods").json()["items"]:
            needed = [one for one in method["inputs"] if one["required"]]
            if self._over.is_set() or any(one["kind"] not in kinds for one in needed):
                continue
            inputs = {one["name"]: self._asset(client, kinds[one["kind"]]) for one in needed}
            body = {"method": method["name"], "inputs": inputs, "seed": self._chance.randrange(1000)}
            answer = self._ask(client, "POST", "/v1/jobs", json=body)
            if answer.status_code != 201:
                self.done[f"job of {method['name']}: refused"] += 1
                continue
            self._finish(client, answer.json()["id"], method["name"])
            self._over.wait(self._pause_s)

    def _finish(self, client: httpx.Client, job_id: str, method: str) -> None:
        while (state := self._ask(client, "GET", f"/v1/jobs/{job_id}").json()["state"]) not in _FINAL:
            if self._over.wait(_POLL_S):
                self._ask(client, "POST", f"/v1/jobs/{job_id}/cancel")
        self.done[f"job of {method}: {state}"] += 1
        if state == "succeeded":
            self._ask(client, "GET", f"/v1/jobs/{job_id}/files/result")
        self._ask(client, "DELETE", f"/v1/jobs/{job_id}")

    def _live(self, client: httpx.Client) -> None:
        """A live session of some frames."""
        asyncio.run(self._session(f"{self._url.replace('http', 'ws', 1)}/v1/live"))
        self._over.wait(self._chance.uniform(0, 2))

    async def _session(self, url: str) -> None:
        hello = {"type": "hello", "method": "abstraction", "width": SIZE[0], "height": SIZE[1], "send": ["jpeg"]}
        async with connect(url) as socket:
            await socket.send(json.dumps(hello))
            await self._until(socket, str)  # ready
            for number in range(1, _LIVE_FRAMES):
                await socket.send(pack(number, SIZE, samples()["jpg"][0]))
                await self._until(socket, bytes)
                self.done["live frames"] += 1
            await socket.send('{"type": "bye"}')
        self.done["live sessions"] += 1

    async def _until(self, socket: ClientConnection, kind: type[str] | type[bytes]) -> None:
        """Read messages until one of this kind: JSON or a painted frame."""
        while not isinstance(await asyncio.wait_for(socket.recv(), 60), kind):
            pass

    def _uploads(self, client: httpx.Client) -> None:
        """A resumable upload in two pieces; the asset is deleted again."""
        data = samples()["png"][0] + bytes(self._chance.randrange(1, 2000))
        tus = {"Tus-Resumable": "1.0.0"}
        piece = tus | {"Content-Type": "application/offset+octet-stream"}
        made = self._ask(client, "POST", "/v1/uploads", headers=tus | {"Upload-Length": str(len(data))})
        where, half = made.headers["location"], len(data) // 2
        for at, part in ((0, data[:half]), (half, data[half:])):
            done = self._ask(client, "PATCH", where, headers=piece | {"Upload-Offset": str(at)}, content=part)
        if asset := done.headers.get("impasto-asset"):
            self._ask(client, "DELETE", f"/v1/assets/{asset}")
        self.done["uploads"] += 1
        self._over.wait(self._chance.uniform(0, 0.5))

    def _poll(self, client: httpx.Client) -> None:
        """Pages, and the addresses that pages ask."""
        for path in _PAGES:
            self._ask(client, "GET", path)
            self.done["polls"] += 1
        self._over.wait(_POLL_S)


def failures(done: Counter[str]) -> dict[str, int]:
    """Failures so far."""
    return {name: times for name, times in done.items() if name.startswith("fault") or name.endswith(": failed")}


def wait(seconds: float, every_s: float, act: Callable[[], None]) -> None:
    """Call `act` every `every_s` seconds for `seconds`."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        act()
        time.sleep(min(every_s, max(0.0, end - time.monotonic())))
