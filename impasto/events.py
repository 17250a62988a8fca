"""Server-Sent Events: resumed after a broken connection, and replaced by polling if streams are not available."""

from __future__ import annotations

import json
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import httpx
from pydantic import JsonValue

from impasto.problems import error_of

SILENCE_S = 45.0
"""Maximum interval of comments or events in a stream, seconds; a longer silence means a broken connection."""
LONGEST_PAUSE_S = 10.0


@dataclass(frozen=True)
class ServerEvent:
    """One event: its `seq` within the job (0 when it has none), its type, and its data."""

    seq: int
    type: str
    data: JsonValue


class NotAStream(Exception):
    """The answer is not an event stream, for example because of a proxy."""


def parse(lines: Iterable[str]) -> Iterator[ServerEvent | None]:
    """Events from the lines of a `text/event-stream`, None for a comment; half an event at the end is dropped."""
    fields: dict[str, list[str]] = {}
    for line in lines:
        if not line:
            if "data" in fields:
                yield _event(fields)
            fields = {}
            continue
        name, _, value = line.partition(":")
        if not name:
            yield None
        else:
            fields.setdefault(name, []).append(value.removeprefix(" "))


def _event(fields: dict[str, list[str]]) -> ServerEvent:
    text = "\n".join(fields["data"])
    try:
        data = json.loads(text)
    except ValueError:
        data = text
    number = fields.get("id", ["0"])[-1]
    return ServerEvent(int(number) if number.isdigit() else 0, fields.get("event", ["message"])[-1], data)


def follow(http: httpx.Client, path: str, *, after: int = 0, poll_s: float = 1.0) -> Iterator[ServerEvent | None]:
    """Yield the events of `path` with seq > `after`, without end.

    Yields None when the caller should read the state itself: after a heartbeat, after a broken connection, which is
    resumed after the last event, and every `poll_s` seconds if no stream is available.
    """
    last, pause = after, 0.0
    while True:
        try:
            for event in _stream(http, path, last):
                last, pause = max(last, event.seq if event else 0), 0.0
                yield event
        except NotAStream:
            yield from _ticks(poll_s)
        except httpx.TransportError:
            pause = min(max(2 * pause, poll_s), LONGEST_PAUSE_S)
        yield None
        time.sleep(pause or min(poll_s, 0.2))


def _stream(http: httpx.Client, path: str, last: int) -> Iterator[ServerEvent | None]:
    headers = {"Accept": "text/event-stream"} | ({"Last-Event-ID": str(last)} if last else {})
    timeout = httpx.Timeout(http.timeout.connect, read=SILENCE_S)
    with http.stream("GET", path, headers=headers, timeout=timeout) as response:
        if response.status_code in (429, 502, 503, 504):
            raise httpx.ReadError(f"the service answered {response.status_code}")
        if response.status_code in (401, 403, 404):
            response.read()
            raise error_of(response)
        if not response.headers.get("content-type", "").startswith("text/event-stream"):
            raise NotAStream
        yield from parse(response.iter_lines())


def _ticks(poll_s: float) -> Iterator[None]:
    while True:
        yield None
        time.sleep(poll_s)
