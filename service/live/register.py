"""Publishes this process's live sessions to the farm, and ends those that an operator has ordered to end."""

from __future__ import annotations

import asyncio
import os
import socket

from starlette.concurrency import run_in_threadpool

from service.live.sessions import Sessions
from workers.farm import Farm
from workers.ids import new_id

EVERY_S = 2.0
"""Seconds between updates: the age of published figures, and the delay of an operator's command."""


async def register(farm: Farm, sessions: Sessions) -> None:
    """Publish until cancelled. Without sessions, nothing is written."""
    process = f"{new_id('srv_')}@{socket.gethostname()}:{os.getpid()}"
    published = False
    while True:
        if (views := sessions.views()) or published:
            ending = await run_in_threadpool(farm.workers.publish_live, process, views)
            for session_id in ending:
                await sessions.dismiss(session_id)
            published = bool(views)
        await asyncio.sleep(EVERY_S)
