"""Conversion of rows to data types and back, and cursors of listings."""

from __future__ import annotations

import base64
import json
from dataclasses import asdict
from typing import Any, TypeAlias, TypedDict

from pydantic import JsonValue
from sqlalchemy import RowMapping, Select

from pipeline.errors import BadParameter
from pipeline.video.media import SourceOptions
from workers.contract.record import ApiKey, Asset, Delivery, Event, Fault, JobWarning, TaskState
from workers.contract.request import WARN, JobRequest, Json, OutputSpec
from workers.jobs.state_machine import Counts
from workers.strict_json import BadJson, strict_json

Row: TypeAlias = RowMapping | dict[str, Any]
"""A row as read: column -> value."""
Values: TypeAlias = dict[str, object]
"""A row as written: column -> value."""
AnySelect: TypeAlias = Select[Any]
"""A query with any columns."""
_CURSOR_VALUES = 20
_LARGEST = 2**63 - 1


class TaskRow(TypedDict, total=False):
    """A row of `tasks`."""

    id: str
    job_id: str
    step: int
    position: int
    key: str
    args: Json
    emit_start: int | None
    """First emitted frame and, in `emit_stop`, one past the last; None: the task emits none."""
    emit_stop: int | None
    weight: float
    chained: bool
    needs: Json | None
    state: str
    blockers: int
    failures: int
    interruptions: int
    ready_at: float
    progress: float
    attempt_id: str | None


def emitted_run(task: TaskRow) -> tuple[int, int] | None:
    """Frames [first, end) that the task emits; None: none."""
    start, stop = task["emit_start"], task["emit_stop"]
    return None if start is None or stop is None else (start, stop)


def asset_of(row: Row) -> Asset:
    return Asset(**{name: row[name] for name in Asset.__dataclass_fields__})


def request_to_json(request: JobRequest) -> Json:
    """JSON of a request. Fields that earlier versions lack are left out if they have their default, so that both
    versions can share a database, and a repeated request still equals the one of its idempotency key."""
    value = asdict(request)
    if request.frames is None:
        del value["frames"]
    if request.on_damage == WARN:
        del value["on_damage"]
    value["source"] = request.source.as_json()
    if request.source == SourceOptions():
        del value["source"]
    if not request.output.profile:
        del value["output"]["profile"]
    if request.output.alpha == "auto":
        del value["output"]["alpha"]
    for name in ("colour", "passes", "passes_format"):
        if not value["output"][name]:
            del value["output"][name]
    return value


def request_of(value: Json) -> JobRequest:
    lists = {name: tuple(value["output"].get(name, ())) for name in ("artefacts", "passes")}
    output = OutputSpec(**{**value["output"], **lists})
    frames = None if value.get("frames") is None else tuple(value["frames"])
    source = SourceOptions.from_json(value.get("source"))
    return JobRequest(**{**value, "output": output, "frames": frames, "source": source})


def fault_to_json(fault: Fault | None) -> Json | None:
    return None if fault is None else asdict(fault)


def fault_of(value: Json | None) -> Fault | None:
    return None if value is None else Fault(**value)


def warnings_of(value: list[Json] | None) -> tuple[JobWarning, ...]:
    return tuple(JobWarning(**each) for each in value or ())


def event_of(row: Row) -> Event:
    return Event(row["seq"], row["job_id"], row["at"], row["type"], row["data"])


def key_of(row: Row) -> ApiKey:
    """A key with its owner's quotas (`owner_quotas`); one that an earlier program made is its own owner."""
    quotas = row["quotas"] if row["owner_quotas"] is None else row["owner_quotas"]
    owner = row["owner"] or row["id"]
    own = {name: row[name] for name in ("id", "name", "created_at", "revoked_at", "expires_at", "used_at", "session")}
    return ApiKey(owner=owner, scopes=frozenset(row["scopes"]), quotas=quotas, **own)


def delivery_of(row: Row) -> Delivery:
    return Delivery(**{name: row[name] for name in Delivery.__dataclass_fields__})


def counts_of(row: Row) -> Counts:
    return Counts(**{state.value: row[state.value] for state in TaskState})


def pack_cursor(*parts: JsonValue) -> str:
    return base64.urlsafe_b64encode(json.dumps(parts).encode()).decode().rstrip("=")


def _is(part: object, kind: type) -> bool:
    """Whether a part of a cursor has this type, and fits into a column of the database."""
    return type(part) is kind and not (isinstance(part, int) and abs(part) > _LARGEST)


def unpack_cursor(cursor: str, *kinds: type) -> list[Any]:
    """The parts of a cursor that a listing gave out, or `BadParameter`."""
    try:
        parts: Any = strict_json(base64.urlsafe_b64decode(cursor + "=" * (-len(cursor) % 4)), _CURSOR_VALUES)
        if len(parts) == len(kinds) and all(_is(part, kind) for part, kind in zip(parts, kinds, strict=True)):
            return list(parts)
    except (BadJson, ValueError, TypeError):
        pass
    raise BadParameter(
        "This is not a cursor of this listing.",
        field="cursor",
        value=cursor,
        remedy="Pass the `cursor` of the previous page, unchanged, or none for the first page.",
    )
