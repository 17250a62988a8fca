"""What runs beside the requests: the webhook sender, the sweeper of forgotten uploads, and the register of live
sessions."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from functools import partial

from starlette.concurrency import run_in_threadpool

from service.access.depends import Service
from service.live.register import register
from service.live.sessions import Sessions
from service.uploads.store import UploadStore
from service.webhooks.sender import Sender

log = logging.getLogger(__name__)

SWEEP_EVERY_S = 600.0
PAUSE_S = 5.0


@asynccontextmanager
async def background(parts: Service, sessions: Sessions) -> AsyncIterator[None]:
    """Work while the app is up."""
    sender = Sender(parts.farm.webhooks, parts.webhook_secrets, parts.settings)
    jobs = (sender.run, _sweeper(parts), partial(register, parts.farm, sessions))
    tasks = [asyncio.create_task(_for_ever(job)) for job in jobs]
    try:
        yield
    finally:
        parts.closing.set()
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


async def _for_ever(work: Callable[[], Awaitable[None]]) -> None:
    while True:
        try:
            await work()
        except Exception:
            log.exception("Background work failed; it begins again in %g s", PAUSE_S)
        await asyncio.sleep(PAUSE_S)


def _sweeper(parts: Service) -> Callable[[], Awaitable[None]]:
    store = UploadStore(parts.settings.uploads_dir, parts.settings.upload_ttl_s)

    async def sweep() -> None:
        while True:
            await run_in_threadpool(store.sweep)
            await asyncio.sleep(SWEEP_EVERY_S)

    return sweep
