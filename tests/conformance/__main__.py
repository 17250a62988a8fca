"""`python -m tests.conformance FOLDER...`: compare every file, print differences and counts, write a table."""

from __future__ import annotations

import argparse
import json
import os
import resource
import signal
import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path

from tests.conformance.compare import Verdict, verdict
from tests.conformance.facts import Facts
from tests.conformance.ours import by_impasto
from tests.conformance.reference import STILLS, by_library

FILMS = frozenset(
    (".mp4", ".mkv", ".webm", ".mov", ".avi", ".ts", ".flv", ".mpg", ".mpeg", ".ps", ".3gp", ".m4v", ".ogv", ".mxf")
) | {".m2ts", ".mts", ".wmv", ".h264"}
KINDS = {"films": FILMS, "stills": STILLS | {".exr", ".dpx"}, "all": FILMS | STILLS | {".exr", ".dpx"}}
TIMEOUT_S = 600
MEMORY_BYTES = 6 << 30


def apart(read: Callable[[Path], Facts], path: Path) -> Facts:
    """Read in a child process, which may crash or hang."""
    ours, theirs = os.pipe()
    if (child := os.fork()) == 0:
        signal.alarm(TIMEOUT_S)
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
        try:
            answer = read(path)
        except BaseException as error:
            answer = Facts(refused=f"FAULT {type(error).__name__}: {error}"[:300])
        with os.fdopen(theirs, "w") as out:
            json.dump(answer.as_json(), out)
        os._exit(0)
    os.close(theirs)
    with os.fdopen(ours) as pipe:
        text = pipe.read()
    os.waitpid(child, 0)
    return Facts.from_json(json.loads(text)) if text else Facts(refused="FAULT crashed or hung")


def guarded(path: Path) -> Facts:
    """Read with Impasto, whose decoders run in child processes of their own."""
    try:
        return by_impasto(path)
    except Exception as error:
        return Facts(refused=f"FAULT {type(error).__name__}: {error}"[:300])


def main() -> int:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("folders", nargs="+", type=Path, help="folders, or files")
    options.add_argument("--kinds", choices=KINDS, default="all")
    options.add_argument("--largest", type=int, default=4_000_000, help="bytes of the largest file")
    options.add_argument("--most", type=int, default=10_000, help="files of one folder")
    options.add_argument("--table", type=Path, help="write every verdict to this file")
    asked = options.parse_args()
    found: list[Verdict] = []
    if asked.table:
        asked.table.write_text("| file | verdict | why |\n|---|---|---|\n")
    for root in asked.folders:
        within = [root] if root.is_file() else root.rglob("*")
        files = sorted(p for p in within if p.suffix.lower() in KINDS[asked.kinds] and p.is_file())
        small = [path for path in files if path.stat().st_size <= asked.largest][: asked.most]
        for path in small:
            found.append(verdict(path, root.parent, apart(by_library, path), guarded(path)))
            if asked.table:
                with asked.table.open("a") as table:
                    table.write(f"| {found[-1].file} | {found[-1].kind} | {found[-1].why.replace('|', '/')} |\n")
            if found[-1].kind == "different":
                print(f"{found[-1].file}: {found[-1].why}", flush=True)
    counts = Counter(each.kind for each in found)
    print(f"{len(found)} files: " + ", ".join(f"{count} {kind}" for kind, count in counts.most_common()))
    return min(1, counts["different"])


if __name__ == "__main__":
    sys.exit(main())
