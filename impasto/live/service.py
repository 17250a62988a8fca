"""The service of a live stream: a given address, one on this machine, or one started for the stream."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import httpx

from impasto_client import DEFAULT_SERVER
from impasto_client.errors import ServiceUnreachable

START_S = 60.0


@contextmanager
def service(named: str, print_status: Callable[[str], None]) -> Iterator[str]:
    """The address of a service.

    Args:
        named: an address. If it is the default one and no service answers there, a service is started on a free port
            with an empty home, and stopped at the end.
        say: called with a message when a service is started.

    Raises: ServiceUnreachable (it does not start).
    """
    if named != DEFAULT_SERVER or _answers(named):
        yield named
        return
    print_status(
        "No service runs on this machine: starting one until this command ends. `impasto serve` keeps one running."
    )
    with tempfile.TemporaryDirectory(prefix="impasto-") as home, _started(home) as address:
        yield address


def _answers(address: str) -> bool:
    try:
        return httpx.get(f"{address}/healthz", timeout=2.0, trust_env=False).is_success
    except httpx.TransportError:
        return False


@contextmanager
def _started(home: str) -> Iterator[str]:
    command = [sys.executable, "-m", "impasto", "serve", "--host", "127.0.0.1", "--port", "0", "--home", home]
    # A new session, so that Ctrl-C reaches only the stream, which ends first.
    child = subprocess.Popen(  # noqa: S603  (our own command)
        command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, start_new_session=True
    )
    try:
        assert child.stdout is not None
        address = child.stdout.readline().strip()
        if not address:
            raise ServiceUnreachable(
                "A service could not be started.", field="server", value=child.wait(START_S),
                remedy="Run `impasto serve` to see why, or name one with --server.",
            )  # fmt: skip
        yield address
    finally:
        child.terminate()
        try:
            child.wait(15)
        except subprocess.TimeoutExpired:
            child.kill()
            child.wait()
