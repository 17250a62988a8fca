"""Delivers webhooks from the farm's outbox, signed as Standard Webhooks 1.0.0. Redirects are not followed.

The farm stores messages and schedules retries; this module makes one attempt at a time for each. A receiver that hangs
occupies one of `SLOTS` until the time-out.
"""

from __future__ import annotations

import asyncio
import json
import logging
from datetime import UTC, datetime

import httpcore
from standardwebhooks import Webhook
from starlette.concurrency import run_in_threadpool

from service.settings import Settings
from service.webhooks.connect import open_pool
from service.webhooks.secrets import WebhookSecrets
from workers.contract.record import Delivery
from workers.errors import NotFound
from workers.process.log_context import log_extra
from workers.store.webhooks import Webhooks

log = logging.getLogger(__name__)

SLOTS = 32
LEASE_FACTOR = 3
"""Lease of a claimed message in time-outs: if this process dies, another one then delivers it."""


class Sender:
    """Sends due messages until cancelled.

    Args:
        outbox: the farm's outbox of messages.
        secrets: the signing secret of each owner.
        settings: time-out, polling interval, whether private receivers are allowed.
    """

    def __init__(self, outbox: Webhooks, secrets: WebhookSecrets, settings: Settings) -> None:
        self._outbox, self._secrets, self._settings = outbox, secrets, settings
        self._free = SLOTS

    async def run(self) -> None:
        async with open_pool(self._settings.webhook_private) as pool, asyncio.TaskGroup() as tasks:
            while True:
                for delivery in await self._due():
                    self._free -= 1
                    tasks.create_task(self._try(pool, delivery))
                await asyncio.sleep(self._settings.webhook_poll_s)

    async def _due(self) -> list[Delivery]:
        if self._free <= 0:
            return []
        lease_s = LEASE_FACTOR * self._settings.webhook_timeout_s
        try:
            return await run_in_threadpool(self._outbox.due, self._free, lease_s)
        except Exception:  # the database may be unreachable: try again later
            log.exception("The webhook outbox cannot be read")
            return []

    async def _try(self, pool: httpcore.AsyncConnectionPool, delivery: Delivery) -> None:
        try:
            status, error = await self._deliver(pool, delivery)
            await run_in_threadpool(self._outbox.record, delivery.id, status, error)
        except NotFound:
            log.info("The job of webhook %s has been deleted", delivery.id, extra=log_extra(job=delivery.job_id))
        except Exception:  # its lease expires, and it is sent again
            log.exception(
                "The outcome of webhook %s cannot be stored", delivery.id, extra=log_extra(job=delivery.job_id)
            )
        finally:
            self._free += 1

    async def _deliver(self, pool: httpcore.AsyncConnectionPool, delivery: Delivery) -> tuple[int | None, str]:
        """One attempt. Returns (HTTP status or None, error message or "")."""
        body = json.dumps(delivery.body, separators=(",", ":"), ensure_ascii=False)
        headers = [*sign(self._secrets.of(delivery.owner), delivery.id, datetime.now(UTC), body).items()]
        try:
            async with asyncio.timeout(self._settings.webhook_timeout_s):
                async with pool.stream("POST", delivery.url, headers=headers, content=body.encode()) as answer:
                    return answer.status, "" if 200 <= answer.status < 300 else f"HTTP {answer.status}"
        except TimeoutError:
            return None, f"no answer within {self._settings.webhook_timeout_s:g} s"
        except (httpcore.NetworkError, httpcore.ProtocolError, httpcore.UnsupportedProtocol, OSError, ValueError) as e:
            return None, str(e)[:200] or type(e).__name__


def sign(secret: str, message_id: str, at: datetime, body: str) -> dict[str, str]:
    """The headers of a signed message."""
    return {
        "Content-Type": "application/json",
        "User-Agent": "Impasto-Webhooks/1",
        "webhook-id": message_id,
        "webhook-timestamp": str(int(at.timestamp())),
        "webhook-signature": Webhook(secret).sign(message_id, at, body),
    }
