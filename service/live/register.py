"""Live sessions made known to operators of all processes, and ended at their wish."""

from __future__ import annotations

import asyncio
import os
import socket

from starlette.concurrency import run_in_threadpool

from service.live.sessions import Sessions
from workers.farm import Farm
from workers.ids import new_id

EVERY_S = 2.0
"""Between two looks: the figures' age, and how soon an operator's wish is heard."""


async def register(farm: Farm, sessions: Sessions) -> None:
    """Until it is cancelled. Says nothing while there is nothing to say."""
    process = f"{new_id('srv_')}@{socket.gethostname()}:{os.getpid()}"
    said = False
    while True:
        if (views := sessions.views()) or said:
            ending = await run_in_threadpool(farm.fleet.publish_live, process, views)
            for session_id in ending:
                await sessions.dismiss(session_id)
            said = bool(views)
        await asyncio.sleep(EVERY_S)
