"""`python -m tests.second_run`: after `make test` has failed, runs the tests that failed once more, one by one.

On a busy machine a server, a browser or a thread may miss the time limit of its test. What only computes has no time
limit: the failure of such a test is final, and so is that of a file that cannot be imported. The end of the log names
each test that needed a second run, with what came of it.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

COMPUTES = ("tests/client/", "tests/costs/", "tests/docs/", "tests/laws/", "tests/pipeline/", "tests/regression/")
"""Folders whose tests compute: they wait for nothing but their own results."""
WAITS = (
    "tests/client/test_corporate_network.py",
    "tests/client/test_wheel.py",
    "tests/laws/test_seven_ways.py",
    "tests/pipeline/kernels/test_jit.py",
    "tests/pipeline/kernels/test_kernel_cache.py",
    "tests/pipeline/video/test_guard.py",
    "tests/pipeline/video/test_probe.py",
)
"""The files of these folders that wait for a server, a process or a thread, within a time limit."""
FAILED = Path(".pytest_cache/v/cache/lastfailed")
"""Where pytest keeps the ids of the tests that have failed and have not passed since."""


def is_final(test: str) -> bool:
    """Whether the failure of the test with this id is final, without a second run."""
    file, _, name = test.partition("::")
    return not name or (file.startswith(COMPUTES) and file not in WAITS)


def main(failed: Iterable[str]) -> int:
    """Run these tests again, unless a failure is final. Returns the exit status: 0 if all have passed."""
    tests = sorted(failed)
    final = [test for test in tests if is_final(test)]
    if final or not tests:
        print("\n".join(["These failures are final:", *final] if final else ["No test has failed, but another step."]))
        return 1
    named_at_the_end = "-rap"  # all that did not pass, and what passed
    return subprocess.run([sys.executable, "-m", "pytest", named_at_the_end, *tests], check=False).returncode


if __name__ == "__main__":
    sys.exit(main(json.loads(FAILED.read_text()) if FAILED.exists() else ()))
