"""Connects to a Ray cluster: an existing one, or one started on this machine."""

from __future__ import annotations

import logging
import signal

import ray
from ray.exceptions import RayError

from pipeline.errors import StorageError
from workers.contract.request import Json
from workers.settings import FarmSettings

_OBJECT_STORE_BYTES = 256 << 20
"""Limit of the object store, whose memory is allocated on use. Orders and outcomes have a few kilobytes; blobs bypass
it."""
_LOCAL = {
    "object_store_memory": _OBJECT_STORE_BYTES,
    # By default Ray gives all its workers a low priority. Here only those that render have one (see `actors`): live
    # sessions have deadlines.
    "_system_config": {"worker_niceness": 0},
}


def connect(settings: FarmSettings) -> None:
    """`ray.init`, with the process's own SIGTERM handler restored afterwards."""
    local = settings.ray_address == "local"
    own: Json = _LOCAL | {"num_cpus": settings.most_workers} if local else {}
    handler = signal.getsignal(signal.SIGTERM)
    try:
        ray.init(
            address=settings.ray_address,
            include_dashboard=False if local else None,
            log_to_driver=False,
            logging_level=logging.WARNING,
            configure_logging=False,
            **own,
        )
    except (RayError, ConnectionError, RuntimeError, ValueError) as error:
        raise StorageError(f"The Ray cluster cannot be used: {error}.", remedy="Check its address.") from error
    finally:
        if handler is not None:
            signal.signal(signal.SIGTERM, handler)
