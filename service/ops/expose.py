"""A metrics endpoint for processes without the HTTP service (`impasto worker`)."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from prometheus_client import CollectorRegistry, start_http_server

from service.ops.machine import add_machine
from service.ops.metrics import FarmMetrics
from service.settings import Settings
from workers.farm import Farm


@contextmanager
def expose(farm: Farm, settings: Settings, port: int | None) -> Iterator[None]:
    """Serve metrics at `settings.host`:`port` from a thread while the block runs; port None: do nothing."""
    if port is None:
        yield
        return
    registry = CollectorRegistry()
    registry.register(FarmMetrics(farm))
    add_machine(registry, settings)
    server, thread = start_http_server(port, settings.host, registry)
    try:
        yield
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
