"""A dispatcher in a separate process that tests kill: it claims tasks, answers, and prints what it did.

`python -m tests.contracts.claimer URL NAME`
"""

from __future__ import annotations

import sys
import time

from workers.contract.order import TaskOutcome
from workers.store import Store

LEASE_S = 1.0


def main(url: str, name: str) -> None:
    store = Store(url)
    print("ready", flush=True)
    while True:
        store.queue.renew(name, LEASE_S)
        store.queue.interrupt([])
        claim = store.queue.claim(name, LEASE_S)
        if claim is None:
            time.sleep(0.02)
        elif store.queue.finish(TaskOutcome(claim.attempt_id, {"by": name}, {}, {}, None, {}, "")):
            print(claim.task["key"], flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
