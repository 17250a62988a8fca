"""Background tasks of the service: sending webhooks, deleting expired uploads, publishing live sessions, load."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from functools import partial

from starlette.concurrency import run_in_threadpool

from service.assets.upload_store import UploadStore
from service.context.depends import ServiceContext
from service.live.register import register
from service.live.sessions import Sessions
from service.webhooks.sender import Sender

log = logging.getLogger(__name__)

SWEEP_EVERY_S = 600.0
PAUSE_S = 5.0


@asynccontextmanager
async def background(context: ServiceContext, sessions: Sessions) -> AsyncIterator[None]:
    """Run the background tasks while the block runs."""
    sender = Sender(context.farm.webhooks, context.webhook_secrets, context.settings)
    jobs = (sender.run, _sweeper(context), partial(register, context.farm, sessions), context.load.run)
    tasks = [asyncio.create_task(_run_forever(job)) for job in jobs]
    try:
        yield
    finally:
        context.closing.set()
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


async def _run_forever(work: Callable[[], Awaitable[None]]) -> None:
    while True:
        try:
            await work()
        except Exception:
            log.exception("Background task failed; restarting in %g s", PAUSE_S)
        await asyncio.sleep(PAUSE_S)


def _sweeper(context: ServiceContext) -> Callable[[], Awaitable[None]]:
    store = UploadStore(context.settings.uploads_dir, context.settings.upload_ttl_s)

    async def sweep() -> None:
        while True:
            await run_in_threadpool(store.sweep)
            await asyncio.sleep(SWEEP_EVERY_S)

    return sweep
