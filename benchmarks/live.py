"""Frame rate and latency of live sessions: a real service with Ray actors, real WebSocket clients on loopback.

    python -m benchmarks live                                     each size for 20 s
    python -m benchmarks.live --seconds 600 --size 640x480@30     an acceptance run
    python -m benchmarks.live --filter steady                     behind abstraction; --prefer sharp: at full size
    python -m benchmarks.live --overload                          a client that sends at 3 times the capacity
    python -m benchmarks.live --sessions 2                        two sessions at once, and a third that is refused
    python -m benchmarks.live --kill                              kill -9 of the worker in mid-stream
    python -m benchmarks.live --rude                              beside clients that do not read, send garbage, vanish
    python -m benchmarks.live --server http://127.0.0.1:8420      a running service: without memory figures and kills

To keep the client's own CPU time low, frames are encoded as JPEG beforehand, and only headers of answers are decoded.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import cv2
import psutil
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from benchmarks.clips import clip
from impasto.live.client import LiveClient, now_us
from impasto.live.wire import SUBPROTOCOL, pack
from pipeline.errors import ImpastoError
from workers.contract.request import Json
from workers.live.statistics import Histogram

SIZES = (((352, 288), 60.0), ((640, 480), 30.0), ((1280, 720), 30.0))
CLIP_FRAMES = 150
MAX_FPS, MAX_PER_S = 120.0, 230.0
"""Highest frame rate that `hello` may declare, and the default limit of incoming frames per second (240) less a margin
for jitter."""
PROBE_S = 5.0
SETTLE_S = 3.0
"""Seconds at the start that are not counted: the first frames of a stream are segmented from scratch."""
UNREAD_S = 60.0
MIB = 1 << 20

Rate = tuple[tuple[int, int], float]


@dataclass
class Run:
    """Measurements of one client."""

    size: tuple[int, int]
    fps: float
    sent: int = 0
    painted: int = 0
    server: Histogram = field(default_factory=Histogram)
    round_trip: Histogram = field(default_factory=Histogram)
    counted: int = 0
    """Frames sent after the first `SETTLE_S` seconds."""
    work: tuple[int, int] = (0, 0)
    gap_s: float = 0.0
    """Longest time between answers."""
    steps: list[str] = field(default_factory=list)
    stats: dict[str, object] = field(default_factory=dict)

    def row(self, seconds: float) -> str:
        lost = 100 * max(0, self.counted - self.painted) / max(1, self.counted)
        parts = "  ".join(
            "/".join(f"{h.percentile(p) * 1e3:.1f}" for p in (50, 95, 99)) for h in (self.server, self.round_trip)
        )
        return (
            f"{self.size[0]}x{self.size[1]}@{self.fps:.0f}  sent {self.counted}  painted {self.painted}  "
            f"dropped {lost:.2f} %  {self.painted / seconds:.1f} frames/s  server/round trip ms p50/95/99 {parts}  "
            f"work {self.work[0]}x{self.work[1]} {' '.join(self.steps)}  longest gap {self.gap_s * 1e3:.0f} ms"
        )


def pictures(size: tuple[int, int]) -> list[bytes]:
    """The frames of a clip as JPEG files."""
    frames = clip(size, CLIP_FRAMES)
    made = [cv2.imencode(".jpg", cv2.cvtColor(f, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, 85])[1] for f in frames]
    return [data.tobytes() for data in made]


def stream(address: str, rate: Rate, payloads: list[bytes], seconds: float, per_s: float = 0.0, **options: Any) -> Run:
    """Send at the rate, or at `per_s` frames a second, for `seconds`; the measurements. `options`: `LiveOptions`."""
    size, fps = rate[0], per_s or rate[1]
    run = Run(size, fps)

    def hear(message: dict[str, object]) -> None:
        if message["type"] == "resolution":
            run.steps.append(f"{message['width']}({message['reason']})")

    with LiveClient(address, on_message=hear, size=size, fps=min(fps, MAX_FPS), **options) as client:
        begin = time.monotonic()
        counter = threading.Thread(target=_count, args=(client, run, begin + SETTLE_S))
        counter.start()
        while (now := time.monotonic()) < begin + SETTLE_S + seconds:
            due = begin + run.sent / fps
            if due > now:
                time.sleep(due - now)
            client.send_payload(payloads[run.sent % len(payloads)], size)
            run.sent += 1
            run.counted += time.monotonic() >= begin + SETTLE_S
        run.stats = client.close()
        counter.join()
    return run


def _count(client: LiveClient, run: Run, from_s: float) -> None:
    last = None
    for answer in client.answers():
        now = time.monotonic()
        run.work = answer.size
        if answer.timestamp / 1e6 < from_s:
            continue
        run.painted += 1
        run.gap_s = max(run.gap_s, now - last) if last else 0.0
        last = now
        run.server.add(answer.latency_us / 1e6)
        run.round_trip.add((now_us() - answer.timestamp) / 1e6)


def too_much(address: str, rate: Rate, payloads: list[bytes]) -> float:
    """Three times the service's capacity at full size, frames a second; at most the service's limit."""
    painted = stream(address, rate, payloads, PROBE_S, MAX_PER_S, prefer="sharp").painted / PROBE_S
    sent = min(3 * painted, MAX_PER_S)
    print(f"    capacity {painted:.1f} frames/s; {sent:.1f} are sent; two periods of the clip {2e3 / rate[1]:.1f} ms")
    return sent


@contextmanager
def service(farm: str) -> Iterator[tuple[str, psutil.Process]]:
    """Start a service; yields its address and process."""
    with tempfile.TemporaryDirectory() as home:
        command = [sys.executable, "-m", "impasto", "serve", "--port", "0", "--home", home, "--farm", farm]
        child = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        try:
            assert child.stdout is not None
            address = child.stdout.readline().strip()
            time.sleep(20)  # spare live workers start at the lowest priority; measure once they are ready
            yield address, psutil.Process(child.pid)
        finally:
            child.terminate()
            child.wait(30)


def live_workers(parent: psutil.Process) -> list[psutil.Process]:
    """The live workers' processes, by CPU time, highest first."""
    found = []
    for process in parent.children(recursive=True):
        with contextlib.suppress(psutil.Error):
            if "LiveActor" in " ".join(process.cmdline()):
                found.append((sum(process.cpu_times()[:2]), process))
    return [process for _, process in sorted(found, key=lambda pair: -pair[0])]


def memory(parent: psutil.Process) -> str:
    """Resident set sizes of the service and of its busiest live worker, MiB."""
    workers = live_workers(parent)
    painter = f"{workers[0].memory_info().rss / MIB:.0f}" if workers else "-"
    return f"service {parent.memory_info().rss / MIB:.0f} MiB, live worker {painter} MiB"


def measure(address: str, parent: psutil.Process | None, rate: Rate, options: argparse.Namespace) -> None:
    """Measure one client, and memory after a tenth of the time and at the end."""
    payloads, memory_samples, seconds = pictures(rate[0]), [], options.seconds
    per_s = too_much(address, rate, payloads) if options.overload else 0.0
    behind: Json | None = {"method": options.filter} if options.filter else None
    if parent is not None:
        _later(SETTLE_S + seconds / 10, lambda: memory_samples.append(memory(parent)))
        _later(SETTLE_S + seconds - 1, lambda: memory_samples.append(memory(parent)))
        if options.kill:
            _later(SETTLE_S + seconds / 2, lambda: live_workers(parent)[0].kill())
    run = stream(address, rate, payloads, seconds, per_s, filter=behind, prefer=options.prefer)
    print(run.row(seconds), flush=True)
    print(f"    stages, mean ms: {run.stats.get('stages_ms')}")
    if memory_samples:
        print(f"    memory: {' -> '.join(memory_samples)}", flush=True)


def _later(seconds: float, act: Callable[[], object]) -> None:
    timer = threading.Timer(seconds, act)
    timer.daemon = True
    timer.start()


def together(address: str, rate: Rate, seconds: float, count: int) -> None:
    """Measure several sessions at once. The service must refuse one more session than it allows."""
    payloads, runs = pictures(rate[0]), []
    threads = [
        threading.Thread(target=lambda: runs.append(stream(address, rate, payloads, seconds))) for _ in range(count)
    ]
    for thread in threads:
        thread.start()
    time.sleep(SETTLE_S)
    began = time.monotonic()
    try:
        with LiveClient(address, size=rate[0]):
            print("    one more session was accepted")
    except ImpastoError as error:
        print(f"    one more: {error.code} after {(time.monotonic() - began) * 1e3:.0f} ms: {error.remedy}")
    for thread in threads:
        thread.join()
    for run in runs:
        print(run.row(seconds), flush=True)


def rude(address: str, rate: Rate) -> None:
    """Measure one well-behaved session while three misbehaving clients connect one after the other."""
    payloads, runs = pictures(rate[0]), []
    good = threading.Thread(target=lambda: runs.append(stream(address, rate, payloads, UNREAD_S + 15)))
    good.start()
    time.sleep(SETTLE_S)
    for name, act in (("does not read", _unread), ("sends garbage", _garbage), ("vanishes", _vanish)):
        with _bare(address, rate) as socket:
            print(f"    {name}: {act(socket, rate, payloads)}", flush=True)
        time.sleep(1)
    good.join()
    print(runs[0].row(UNREAD_S + 15), flush=True)


@contextmanager
def _bare(address: str, rate: Rate) -> Iterator[ClientConnection]:
    """A session on a bare WebSocket: nothing is read unless the caller reads it."""
    (width, height), fps = rate
    hello = {"type": "hello", "method": "abstraction", "width": width, "height": height, "fps": fps}
    url = f"ws{address.removeprefix('http')}/v1/live"
    with connect(url, subprotocols=[Subprotocol(SUBPROTOCOL)], max_queue=1, ping_interval=None) as socket:
        socket.send(json.dumps(hello))
        socket.recv()
        yield socket


def _unread(socket: ClientConnection, rate: Rate, payloads: list[bytes]) -> str:
    _send(socket, rate, payloads, UNREAD_S)
    waiting = 0
    with contextlib.suppress(TimeoutError):
        while True:
            socket.recv(timeout=1)
            waiting += 1
    return f"{UNREAD_S * rate[1]:.0f} frames sent in {UNREAD_S:.0f} s, then {waiting} messages read; still connected"


def _garbage(socket: ClientConnection, rate: Rate, payloads: list[bytes]) -> str:
    _send(socket, rate, payloads, 1.0)
    socket.send(b"\x07" * 1000)
    try:
        while True:
            socket.recv(timeout=5)
    except ConnectionClosed as closed:
        return f"closed with {closed.rcvd.code} {closed.rcvd.reason}" if closed.rcvd else "closed without a close frame"


def _vanish(socket: ClientConnection, rate: Rate, payloads: list[bytes]) -> str:
    _send(socket, rate, payloads, 1.0)
    socket.socket.close()
    return "its socket is closed"


def _send(socket: ClientConnection, rate: Rate, payloads: list[bytes], seconds: float) -> None:
    begin = time.monotonic()
    for sequence in range(1, round(seconds * rate[1]) + 1):
        time.sleep(max(0.0, begin + sequence / rate[1] - time.monotonic()))
        socket.send(pack(payloads[sequence % len(payloads)], rate[0], True, sequence, now_us()))


def main(arguments: list[str] | None = None) -> None:
    """Print one row per run."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.live")
    parser.add_argument("--seconds", type=float, default=20)
    parser.add_argument("--size", help="WIDTHxHEIGHT@FPS; three sizes if omitted")
    parser.add_argument("--farm", default="ray", choices=("ray", "local"))
    parser.add_argument("--server", help="address of a running service; one is started if omitted")
    parser.add_argument("--filter", choices=("steady",), help="behind abstraction")
    parser.add_argument("--prefer", choices=("fluent", "sharp"), default="fluent")
    parser.add_argument("--overload", action="store_true")
    parser.add_argument("--sessions", type=int, default=1)
    parser.add_argument("--kill", action="store_true")
    parser.add_argument("--rude", action="store_true")
    options = parser.parse_args(arguments or [])
    if options.server:
        _all(options, options.server, None)
        return
    with service(options.farm) as (address, parent):
        _all(options, address, parent)


def _all(options: argparse.Namespace, address: str, parent: psutil.Process | None) -> None:
    for rate in _rates(options.size):
        if options.rude:
            rude(address, rate)
        elif options.sessions > 1:
            together(address, rate, options.seconds, options.sessions)
        else:
            measure(address, parent, rate, options)


def _rates(text: str | None) -> tuple[Rate, ...]:
    if not text:
        return SIZES
    size, _, fps = text.partition("@")
    width, _, height = size.partition("x")
    return (((int(width), int(height)), float(fps or 30)),)


if __name__ == "__main__":
    main(sys.argv[1:])
