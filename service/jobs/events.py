"""/v1/jobs/{job_id}/events: Server-Sent Events, resumed by Last-Event-ID.

    id: 17                      the event's `seq`
    event: task.state           its `type`, or "history-gone" when requested events are no longer kept
    data: {"seq": 17, ...}      the event as JSON

The stream ends when the job is final and all events have been sent. If the client connects again, it gets 204, which
tells a browser's EventSource to stop.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncGenerator, Callable
from contextlib import suppress
from dataclasses import asdict, dataclass
from typing import Annotated

import anyio
from anyio.to_thread import run_sync
from fastapi import Header, Response
from starlette.responses import StreamingResponse

from service.access.keys import Principal
from service.context.depends import Context, Reader, ServiceContext
from service.errors import Busy, retry_after
from service.jobs.lookup import find_job
from service.routing import Router
from service.schemas import JobId, Responses
from service.streaming import StreamedResponse
from workers.contract.record import Event
from workers.errors import NotFound

router = Router(prefix="/v1/jobs", tags=["events"])

SLICE_S = 1.0
"""Interval at which a waiting stream looks whether the service closes, seconds."""
AT_ONCE = 500
RETRY_MS = 1000

STREAM: Responses = {
    200: {
        "description": "Events with `id`, `event` and `data` (JSON), until the job ends",
        "content": {"text/event-stream": {"schema": {}}},  # OpenAPI 3.1 cannot describe the items of a stream
    },
    204: {"description": "The job is finished and there is nothing after that event"},
}


@router.get("/{job_id}/events", response_class=StreamingResponse, responses=STREAM)
def get_events(
    job_id: JobId,
    context: Context,
    caller: Reader,
    last_event_id: Annotated[int, Header(ge=0, le=2**53, description="Go on after this `seq`.")] = 0,
) -> Response:
    """The job's events as they occur."""
    job = find_job(context, caller, job_id)
    if last_event_id and job.state.final and not context.farm.jobs.events(job_id, last_event_id, 1)[0]:
        return Response(status_code=204)
    if context.streams.full(caller):
        raise Busy(
            "Too many event streams are open.",
            headers=retry_after(5),
            remedy="Request the job every few seconds instead.",
        )
    headers = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}
    return StreamedResponse(_stream(context, caller, job_id, last_event_id), 200, headers, "text/event-stream")


@dataclass(frozen=True)
class _HistoryRead:
    """Result of one read of the job's history."""

    text: str
    after: int
    over: bool = False


class _News:
    """Tells the event loop that the job has new events."""

    def __init__(self) -> None:
        self._loop, self._event = asyncio.get_running_loop(), asyncio.Event()

    def announce(self) -> None:
        """Call it in any thread."""
        with suppress(RuntimeError):  # the loop has ended
            self._loop.call_soon_threadsafe(self._event.set)

    @property
    def any(self) -> bool:
        return self._event.is_set()

    def forget(self) -> None:
        """Wait for later news only."""
        self._event.clear()

    async def wait(self, timeout_s: float, closing: Callable[[], bool]) -> None:
        """Wait for news, for some time, or until the service closes."""
        end = anyio.current_time() + timeout_s
        while not (self._event.is_set() or closing() or anyio.current_time() >= end):
            with anyio.move_on_after(min(SLICE_S, max(0.0, end - anyio.current_time()))):
                await self._event.wait()


async def _stream(context: ServiceContext, caller: Principal, job_id: str, after: int) -> AsyncGenerator[str]:
    news, closing = _News(), context.closing.is_set
    with context.streams.one(caller), context.farm.jobs.listening(job_id, news.announce):
        yield f"retry: {RETRY_MS}\n\n"
        latest = _HistoryRead("", after)
        while not (latest.over or closing()):
            news.forget()
            latest = await run_sync(_read_history, context, job_id, latest.after, limiter=context.streams.threads)
            if latest.text:
                yield latest.text
            elif not latest.over and not await _heard(news, context):
                yield ": still here\n\n"


async def _heard(news: _News, context: ServiceContext) -> bool:
    """Wait for news; False if none arrive within the heartbeat interval."""
    await news.wait(context.settings.heartbeat_s, context.closing.is_set)
    return news.any or context.closing.is_set()


def _read_history(context: ServiceContext, job_id: str, after: int) -> _HistoryRead:
    """Events after `after`, and whether they are the last."""
    try:
        # The state is read before the events, so that the final event is among them.
        final = context.farm.jobs.get(job_id).state.final
        events, gone = context.farm.jobs.events(job_id, after, AT_ONCE)
    except NotFound:  # the job has been deleted meanwhile
        return _HistoryRead("", after, over=True)
    if events:
        lost = _lost(job_id, after, events[0].seq) if gone else ""
        return _HistoryRead(lost + "".join(map(_text, events)), events[-1].seq)
    return _HistoryRead("", after, over=final)


def _lost(job_id: str, after: int, goes_on: int) -> str:
    data = {"job_id": job_id, "after": after, "goes_on_with": goes_on}
    return f"event: history-gone\ndata: {json.dumps(data)}\n\n"


def _text(event: Event) -> str:
    return f"id: {event.seq}\nevent: {event.type}\ndata: {json.dumps(asdict(event))}\n\n"
