"""The child process of a `ChildRunner`: runs one order after another until its connection is closed."""

from __future__ import annotations

import ctypes
import os
import queue
import signal
import threading
from functools import partial
from multiprocessing.connection import Connection

from pipeline.video.guard.decoder_server import adopt_decoder_server
from workers.blobs.base import Blobs
from workers.contract.order import TaskOrder
from workers.execution.artefact_handover import ArtefactHandover
from workers.execution.decoders import Decoders
from workers.execution.renderer import Renderer, Shared
from workers.pools.child_runner import CancelMessage, Progress, WarmUp
from workers.pools.local_pool import TaskRunner
from workers.process.free_memory import keep_free_memory, limit_free_memory
from workers.process.logs import set_up_logs
from workers.process.starting import WARM_UP_THREAD
from workers.process.vital_signs import show_stacks_on_signal
from workers.settings import FarmSettings

_PR_SET_PDEATHSIG = 1


def main(descriptor: int, decoders: int) -> None:
    """Serve the parent. Never returns.

    Args:
        descriptor: file descriptor of the connection to the parent.
        decoders: file descriptor of the connection to the parent's decoder server.
    """
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)  # also while native code holds the interpreter lock
    show_stacks_on_signal()
    adopt_decoder_server(decoders)
    wire = Connection(descriptor)
    make_runner = wire.recv()
    _Child(wire, make_runner()).serve()


def child_renderer(settings: FarmSettings, blobs: Blobs, overview: bool, one_job: bool) -> Renderer:
    """The runner of a child, made in it.

    Args:
        settings: without addresses and secrets of stores.
        overview: as for `Renderer`.
        one_job: whether the process lives for one job only, and keeps freed memory.
    """
    set_up_logs(settings)
    if one_job:
        keep_free_memory()
    else:
        limit_free_memory()
    return Renderer(blobs, settings.scratch, overview=overview, shared=Shared(Decoders(blobs), ArtefactHandover()))


class _Child:
    def __init__(self, wire: Connection, runner: TaskRunner) -> None:
        self._wire, self._runner = wire, runner
        self._orders: queue.SimpleQueue[TaskOrder] = queue.SimpleQueue()
        self._cancelled = ""
        """Id of the attempt that was cancelled last."""
        self._sending = threading.Lock()

    def serve(self) -> None:
        """Run orders. Never returns."""
        threading.Thread(target=self._listen, name="impasto-orders", daemon=True).start()
        self._send(None)  # ready
        while True:
            order = self._orders.get()
            self._send(self._runner.run(order, self._report, partial(self._is_cancelled, order.attempt_id)))

    def _listen(self) -> None:
        try:
            while True:
                message = self._wire.recv()
                if isinstance(message, CancelMessage):
                    self._cancelled = message.attempt_id
                elif isinstance(message, WarmUp):
                    warm_up = partial(self._runner.warm_up, lambda: False)
                    threading.Thread(target=warm_up, name=WARM_UP_THREAD, daemon=True).start()
                else:
                    self._orders.put(message)
        except (EOFError, OSError):
            os._exit(0)  # the parent has closed the connection, or has died: nobody waits for the result

    def _is_cancelled(self, attempt_id: str) -> bool:
        return self._cancelled == attempt_id

    def _report(self, done: float, preview: str = "") -> None:
        self._send(Progress(done, preview))

    def _send(self, message: object) -> None:
        try:
            with self._sending:
                self._wire.send(message)
        except OSError:
            os._exit(0)
