"""Writes the sync client from the async one: `python client/make_sync.py`. Needs ruff, which formats the result."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

PACKAGE = Path(__file__).resolve().parent / "impasto_client"
WORDS = (
    (r"\basyncio\.to_thread\((\w+), ", r"\1("),
    (r"\bimport asyncio\nimport time\n", "import time\n"),
    (r"\basyncio\b", "time"),
    (r"\b_async\b", "_sync"),
    (r"\basync (def|with|for)\b", r"\1"),
    (r"\bawait ", ""),
    (r"\bhttpx\.Async", "httpx."),
    (r"\bAsync(Connection|Client|Ops|Owners|Projects|Iterator)\b", r"\1"),
    (r"\b(__)a(enter|exit)__", r"\1\2__"),
    (r"\ba(close|read|iter_lines|iter_raw)\b", r"\1"),
    (r"\A.*?\"\"\"\n", '"""Made from `_async` by client/make_sync.py: do not edit."""\n'),
)
"""(Pattern, replacement), in this order."""


def sync(source: str) -> str:
    """The sync text of an async module."""
    for pattern, replacement in WORDS:
        source = re.sub(pattern, replacement, source, flags=re.DOTALL if pattern.startswith(r"\A") else 0)
    ruff = [sys.executable, "-m", "ruff"]
    for command in (["check", "-q", "--fix-only", "--select", "I", "-"], ["format", "-q", "-"]):
        command = [*ruff, *command, "--stdin-filename", str(PACKAGE / "_sync" / "any.py")]
        source = subprocess.run(command, input=source, capture_output=True, text=True, check=True).stdout  # noqa: S603
    return source


def modules() -> dict[Path, str]:
    """The files of `_sync`, and their texts."""
    files = sorted((PACKAGE / "_async").glob("*.py"))
    return {PACKAGE / "_sync" / file.name: sync(file.read_text("utf-8")) for file in files}


if __name__ == "__main__":
    for path, text in modules().items():
        path.write_text(text, "utf-8")
