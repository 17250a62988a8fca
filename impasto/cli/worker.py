"""`impasto worker`: a process that runs tasks of an existing farm, on this machine or another."""

from __future__ import annotations

import signal
import socket
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from types import FrameType
from typing import TYPE_CHECKING, Annotated

import typer

from impasto.cli.console import print_status
from impasto.cli.option_classes import takes_options
from impasto.cli.options import BlobsOption, DatabaseOption, HomeOption, S3EndpointOption, home_of
from workers.process.starting import keep_files_private, without_garbage_collection

if TYPE_CHECKING:
    from service.settings import Settings
    from workers.pools.ray_node import RayNode

EPILOG = """[bold]Examples[/bold]

impasto worker --database postgresql://impasto@db/impasto --blobs s3://films/impasto --workers 4

impasto worker --ray-address head.internal:6379 --workers 8 --gpus 1 --memory 24

The first asks the stores for tasks, as `impasto serve` does: the same stores, a home of its own on a local disk.
The second makes this machine a node of a Ray cluster, which `impasto serve --farm ray --ray-address` uses.

SIGTERM or Ctrl-C lets running tasks end and starts no new ones; a second one returns them to the queue at once.
"""
GRACE_S = 3600.0


@dataclass(frozen=True, kw_only=True)
class WorkerOptions:
    """Options of `impasto worker`."""

    home: HomeOption = None
    workers: Annotated[
        int | None, typer.Option(min=1, max=256, help="Simultaneous tasks; default: as many as fit.")
    ] = None
    database: DatabaseOption = None
    blobs: BlobsOption = None
    s3_endpoint: S3EndpointOption = None
    ray_address: Annotated[str | None, typer.Option(help="HOST:PORT of a Ray cluster that this machine joins.")] = None
    gpus: Annotated[float | None, typer.Option(min=0, help="With --ray-address: GPUs to offer; default: all.")] = None
    memory: Annotated[
        float | None, typer.Option(min=0.5, help="With --ray-address: GiB for tasks; default: most of the free memory.")
    ] = None
    name: Annotated[str | None, typer.Option(help="With --ray-address: name of the node; default: the host's.")] = None
    grace_s: Annotated[float, typer.Option(min=0, help="Time that running tasks may take to end, seconds.")] = GRACE_S
    metrics_port: Annotated[
        int | None, typer.Option(min=1, max=65535, help="Serve Prometheus metrics on this port.")
    ] = None


@takes_options(WorkerOptions)
def worker(options: WorkerOptions) -> None:
    """Run tasks of a farm, without serving requests.

    Once it runs, it prints its name, the only line on stdout.
    """
    from impasto.settings import load
    from service.settings import Settings
    from workers.extras import require_extra
    from workers.pools.ray_node import RayNode
    from workers.process.descriptors import raise_descriptor_limit
    from workers.process.free_memory import limit_free_memory
    from workers.process.logs import set_up_logs

    settings = load(
        Settings,
        home=home_of(options.home),
        role="worker",
        pool="local",
        workers=options.workers,
        database_url=options.database,
        blob_url=options.blobs,
        s3_endpoint_url=options.s3_endpoint,
    )
    keep_files_private()
    set_up_logs(settings)
    raise_descriptor_limit()
    limit_free_memory()
    if options.ray_address is not None:
        require_extra("cluster", "--ray-address", options.ray_address)
        node = RayNode(
            options.ray_address,
            options.name or socket.gethostname(),
            settings.most_workers,
            options.gpus,
            options.memory,
        )
        _join_cluster(settings, node, options.grace_s)
        return
    _join_farm(settings, options.grace_s, options.metrics_port)


def _join_farm(settings: Settings, grace_s: float, metrics_port: int | None) -> None:
    """Run tasks from the stores until a signal arrives."""
    with without_garbage_collection():
        from service.ops.expose import expose
        from workers.farm import open_farm

    signals = _Signals()
    farm = open_farm(settings)
    with expose(farm, settings, metrics_port):
        try:
            farm.start()
            typer.echo(farm.worker_id)
            signals.first.wait()
            print_status("Waiting for running tasks to finish. A second signal returns them to the queue at once.")
            signals.until_second(lambda: farm.drain(1.0), grace_s)
        finally:
            farm.stop()


def _join_cluster(settings: Settings, node: RayNode, grace_s: float) -> None:
    """Run a Ray node until a signal arrives; then drain it, if the database is known."""
    signals = _Signals()
    with node:
        typer.echo(node.name)
        while not signals.first.wait(0.5):
            node.check()
        if settings.database_url:
            _empty(settings, node.name, signals, grace_s)


def _empty(settings: Settings, name: str, signals: _Signals, grace_s: float) -> None:
    """Drain this node and wait until no task runs on it."""
    from workers.farm import open_farm
    from workers.operator_views import DrainScope

    farm = open_farm(settings.model_copy(update={"pool": "none"}))
    try:
        ours = not any(drain.name == name for drain in farm.workers.drains())
        farm.workers.drain(DrainScope.NODE, name, reason="It was asked to stop.")

        def empty() -> bool:
            signals.second.wait(1.0)
            return not any(node.busy for node in farm.workers.nodes() if node.name == name)

        signals.until_second(empty, grace_s)
        if ours:  # the machine may join again after a restart
            farm.workers.resume(DrainScope.NODE, name)
    finally:
        farm.stop()


class _Signals:
    """Waits for the first and the second SIGTERM or SIGINT."""

    def __init__(self) -> None:
        self.first, self.second = threading.Event(), threading.Event()
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._handle_signal)

    def _handle_signal(self, _number: int, _frame: FrameType | None) -> None:
        (self.second if self.first.is_set() else self.first).set()

    def until_second(self, done: Callable[[], bool], patience_s: float) -> None:
        """Call `done` until it returns True, a second signal arrives, or `patience_s` seconds have passed."""
        deadline = time.monotonic() + patience_s
        while not self.second.is_set() and time.monotonic() < deadline and not done():
            pass
