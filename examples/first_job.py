"""Turns a video into a cartoon through a running `impasto serve`.

python examples/first_job.py clip.mp4 cartoon.mp4 [http://127.0.0.1:8420]
"""

from __future__ import annotations

import sys

from impasto import DEFAULT_SERVER, Client


def main(source: str, target: str, server: str = DEFAULT_SERVER) -> None:
    with Client(server) as impasto:
        video = impasto.upload(source)
        job = impasto.submit("abstraction", {"video": video["id"]})
        for now in impasto.watch(job["id"]):
            print(f"{now['state']}: {now['progress']:.0%}")
        impasto.wait(job["id"])  # over by now: raises JobFailed, with the reason, unless it succeeded
        print(impasto.download(job["id"], target))


if __name__ == "__main__":
    main(*sys.argv[1:])
