"""Server-Sent Events: the text of a stream as events."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class ServerEvent:
    """One event: its `seq` within the job (0 when it has none), its type, and its data (JSON)."""

    seq: int
    type: str
    data: Any


class NotAStream(Exception):
    """The answer is not an event stream, for example because of a proxy."""


class Parser:
    """Collects the lines of a `text/event-stream`; half an event at the end is dropped."""

    def __init__(self) -> None:
        self._fields: dict[str, list[str]] = {}

    def line(self, line: str) -> tuple[ServerEvent | None, ...]:
        """Parse one line. Returns the event that an empty line completes, (None,) for a comment, otherwise ()."""
        if not line:
            fields, self._fields = self._fields, {}
            return (_event(fields),) if "data" in fields else ()
        name, _, value = line.partition(":")
        if not name:
            return (None,)
        self._fields.setdefault(name, []).append(value.removeprefix(" "))
        return ()


def _event(fields: dict[str, list[str]]) -> ServerEvent:
    text = "\n".join(fields["data"])
    try:
        data = json.loads(text)
    except ValueError:
        data = text
    number = fields.get("id", ["0"])[-1]
    return ServerEvent(int(number) if number.isdigit() else 0, fields.get("event", ["message"])[-1], data)
