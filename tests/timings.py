"""Where the time of a test run goes, by file: a plugin that records, and a table.

    pytest -p tests.timings --timings times.jsonl ...
    python -m tests.timings times.jsonl             # Markdown, the slowest files first

Each phase of each test has its wall time and its CPU time: of this process with all its threads, and of children that
ended meanwhile. A server that outlives a test is counted where it is stopped.
"""

from __future__ import annotations

import json
import resource
import sys
import time
from collections import defaultdict
from collections.abc import Generator
from pathlib import Path

import pytest

PHASES = ("setup", "call", "teardown")
CPU = ("own_s", "children_s")
HEADER = "| file | setup s | call s | teardown s | CPU s, own | CPU s, children |"


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--timings", metavar="FILE", help="append one JSON line for each phase of each test")


def _used_s() -> dict[str, float]:
    used = {
        "own_s": resource.getrusage(resource.RUSAGE_SELF),
        "children_s": resource.getrusage(resource.RUSAGE_CHILDREN),
    }
    cpu = {whose: usage.ru_utime + usage.ru_stime for whose, usage in used.items()}
    return {"wall_s": time.monotonic(), **cpu}


def _timed(item: pytest.Item, phase: str) -> Generator[None, object, object]:
    before = _used_s()
    try:
        return (yield)
    finally:
        line = {"test": item.nodeid, "phase": phase} | {name: now - before[name] for name, now in _used_s().items()}
        if path := item.config.getoption("--timings"):
            with Path(path).open("a") as sink:
                sink.write(json.dumps(line) + "\n")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_setup(item: pytest.Item) -> Generator[None, object, object]:
    return (yield from _timed(item, "setup"))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, object, object]:
    return (yield from _timed(item, "call"))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_teardown(item: pytest.Item) -> Generator[None, object, object]:
    return (yield from _timed(item, "teardown"))


def table(lines: list[str]) -> str:
    """A Markdown table: a row for each file with its seconds, and their sums."""
    files: dict[str, dict[str, float]] = defaultdict(lambda: dict.fromkeys((*PHASES, *CPU), 0.0))
    for found in map(json.loads, lines):
        for file in (found["test"].split("::")[0], "all"):
            files[file][found["phase"]] += found["wall_s"]
            for whose in CPU:
                files[file][whose] += found[whose]
    rows = sorted(files.items(), key=lambda row: -sum(row[1][phase] for phase in PHASES))
    shown = [f"| {file} | " + " | ".join(f"{spent:.1f}" for spent in times.values()) + " |" for file, times in rows]
    return "\n".join([HEADER, "|---|---|---|---|---|---|", *shown])


if __name__ == "__main__":
    print(table(Path(sys.argv[1]).read_text().splitlines()))
