"""Ports for servers that tests start."""

from __future__ import annotations

import itertools
import os
import socket

FIRST, EACH, PROCESSES = 20_000, 1_000, 12
"""Ports 20,000 to 31,999, a thousand for each test process: above those of Ray's workers, below those from which Linux
takes the ports of outgoing connections (32,768 on)."""

_asked = itertools.count(os.getpid())


def free_port() -> int:
    """A port on which nothing listens, and that no other test process is given.

    The system's own choice (port 0) may go to another process before the server listens.
    """
    process = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw")) % PROCESSES
    for number in itertools.islice(_asked, EACH):
        port = FIRST + process * EACH + number % EACH
        with socket.socket() as probe:
            try:
                probe.bind(("127.0.0.1", port))
            except OSError:
                continue
            return port
    raise OSError("none of the test process's ports is free")
