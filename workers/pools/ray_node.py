"""Makes this machine a node of a Ray cluster: runs and monitors Ray's command. Ray itself is not imported."""

from __future__ import annotations

import logging
import os
import subprocess
import sys
import tempfile
from types import TracebackType
from typing import Self

from pipeline.errors import StorageError

log = logging.getLogger(__name__)

STOP_S = 20.0


class RayNode:
    """A Ray node of an existing cluster, for the duration of a `with` block. Raises StorageError if it does not start,
    or ends.

    Args:
        address: host:port of the cluster's head.
        name: as operators know the node.
        cpus: number of tasks that may run here at once, one processor each.
        gpus: GPUs to offer; None: those that Ray finds.
        memory_gib: memory to offer; None: the free memory that Ray finds, minus its object store.
    """

    def __init__(
        self, address: str, name: str, cpus: int, gpus: float | None = None, memory_gib: float | None = None
    ) -> None:
        self.name = name
        self._command = [
            *(sys.executable, "-c", "from ray.scripts.scripts import main; main()", "start", "--block"),
            *("--address", address, "--node-name", name, "--num-cpus", str(cpus), "--disable-usage-stats"),
            "--include-log-monitor=false",  # the log monitor sends workers' output to drivers; ours do not need it
            *(() if gpus is None else ("--num-gpus", f"{gpus:g}")),
            *(() if memory_gib is None else ("--memory", str(int(memory_gib * (1 << 30))))),
        ]
        self._output = tempfile.TemporaryFile()  # noqa: SIM115  (closed by __exit__)
        self._process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> Self:
        self._process = subprocess.Popen(  # noqa: S603  (our own arguments)
            self._command,
            stdin=subprocess.DEVNULL,
            stdout=self._output,
            stderr=subprocess.STDOUT,
            start_new_session=True,
            env={"RAY_worker_niceness": "0", **os.environ},  # otherwise live sessions have a low priority, too
        )
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End the node: after SIGTERM, `ray start --block` ends the raylet that it started."""
        assert self._process is not None
        self._process.terminate()
        try:
            self._process.wait(STOP_S)
        except subprocess.TimeoutExpired:
            log.warning("the Ray node does not end; it is killed")
            self._process.kill()
            self._process.wait()
        self._output.close()

    def check(self) -> None:
        """Raise StorageError if the node has ended, for example because the head has."""
        assert self._process is not None
        if self._process.poll() is not None:
            self._output.seek(0)
            said = self._output.read()[-2000:].decode("utf-8", "replace").strip()
            if "Traceback (most recent call last)" in said:
                said = said.splitlines()[-1]  # the error itself
            raise StorageError(
                f"The Ray node has ended: {said or 'it said nothing'}.",
                field="ray_address",
                remedy="Check that the cluster's head is up and can be reached, then start again.",
            )
