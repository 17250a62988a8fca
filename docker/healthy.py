#!/usr/bin/env python3
"""Health check of a container: `healthy.py service` or `healthy.py worker`. Exits with status 0 if it is healthy."""

from __future__ import annotations

import os
import sys
import urllib.error
import urllib.request

TIMEOUT_S = 4.0
RAY_AGENT_PORT = 52365


def address(kind: str) -> str:
    """URL of the health check: our own endpoint, or that of Ray's agent for its node."""
    if kind == "service":
        return f"http://127.0.0.1:{os.environ.get('IMPASTO_PORT', '8420')}/healthz"
    return f"http://127.0.0.1:{os.environ.get('RAY_AGENT_PORT', RAY_AGENT_PORT)}/api/local_raylet_healthz"


def main(kind: str) -> int:
    try:
        with urllib.request.urlopen(address(kind), timeout=TIMEOUT_S) as answer:  # noqa: S310  (a fixed http address)
            return 0 if answer.status == 200 else 1
    except (urllib.error.URLError, OSError) as error:
        print(f"{kind}: {error}", file=sys.stderr)
        return 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1] if len(sys.argv) > 1 else "service"))
