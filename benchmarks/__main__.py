"""`python -m benchmarks [name ...]`: run all benchmarks, or those named."""

from __future__ import annotations

import sys

from benchmarks import (
    abstraction,
    analogy,
    api,
    dispatch,
    flow,
    kill9,
    lines,
    live,
    memory,
    methods,
    multistyle,
    overhead,
    patches,
    speedup,
    steady,
    workers,
)

ALL = {
    "methods": methods.main,
    "abstraction": abstraction.main,
    "analogy": analogy.main,
    "multistyle": multistyle.main,
    "patches": patches.main,
    "flow": flow.main,
    "workers": workers.main,
    "memory": memory.main,
    "kill9": kill9.main,
    "lines": lines.main,
    "live": live.main,
    "dispatch": dispatch.main,
    "overhead": overhead.main,
    "api": api.main,
    "speedup": speedup.main,
    "steady": steady.main,
}


def main() -> None:
    names = sys.argv[1:] or list(ALL)
    unknown = [name for name in names if name not in ALL]
    if unknown:
        sys.exit(f"No benchmark named {unknown[0]}. There are: {', '.join(ALL)}.")
    for name in names:
        print(f"\n== {name}")
        ALL[name]()


if __name__ == "__main__":
    main()
