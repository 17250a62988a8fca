# SPDX-License-Identifier: GPL-3.0-or-later
"""Talks to the service: its methods, and painting one job. Uses nothing of ComfyUI."""

from __future__ import annotations

import json
import logging
import os
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from impasto_client import DEFAULT_SERVER, FINAL, Client, ImpastoError, ServiceUnreachable
from impasto_client.problems import job_failed

CONNECT_S = 5.0
POLL_S = 0.25
RETRY_S = 60.0
"""Time for which a painting waits for a service that does not answer, seconds."""
REMEMBERED = Path(__file__).with_name("methods.json")
"""The methods of the last service that answered. Nodes of saved graphs exist also while the service is away."""
log = logging.getLogger("impasto")
Tell = Callable[[float], None]
"""Called with the share of the work that is done, 0..1; an exception that it raises ends the work."""


def connected(timeout_s: float = 30.0) -> Client:
    """A client for IMPASTO_SERVER with IMPASTO_API_KEY, which are no inputs: saved graphs would hold the key."""
    return Client(os.environ.get("IMPASTO_SERVER", DEFAULT_SERVER), os.environ.get("IMPASTO_API_KEY", ""), timeout_s)


def methods() -> list[dict[str, Any]]:
    """Methods of the service; if it does not answer, those of the last answer; without one, none."""
    try:
        with connected(CONNECT_S) as client:
            found: list[dict[str, Any]] = client.methods()
    except ImpastoError as error:
        remembered = json.loads(REMEMBERED.read_text("utf-8")) if REMEMBERED.exists() else []
        log.warning("Impasto: %s Nodes of the last answer: %d.", error, len(remembered))
        return remembered
    try:
        REMEMBERED.write_text(json.dumps(found), "utf-8")
    except OSError as error:
        log.warning("Impasto: the methods are not remembered: %s", error)
    return found


def paint(client: Client, request: Mapping[str, Any], target: Path, tell: Tell) -> dict[str, Any]:
    """Submit a job, wait for it, download its result to `target`; return the job.

    If `tell` raises, the job is cancelled. Raises: ImpastoError with field, value and remedy.
    """
    job = client.submit(**request)
    try:
        job = _ended(client, job, tell)
    except BaseException:
        _cancel(client, job["id"])
        raise
    if job["state"] != "succeeded":
        raise job_failed(job)
    client.download(job["id"], target, progress=lambda done, total: tell(1.0))
    return job


def _ended(client: Client, job: dict[str, Any], tell: Tell) -> dict[str, Any]:
    answered = time.monotonic()
    while job["state"] not in FINAL:
        tell(job["progress"])
        time.sleep(POLL_S)
        try:
            job, answered = client.job(job["id"]), time.monotonic()
        except ServiceUnreachable:
            if time.monotonic() - answered > RETRY_S:
                raise
    return job


def _cancel(client: Client, job_id: str) -> None:
    try:
        client.cancel(job_id)
    except ImpastoError as error:
        log.warning("Impasto: job %s was not cancelled: %s", job_id, error)
