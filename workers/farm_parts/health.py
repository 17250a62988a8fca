"""Health checks of a farm's parts, answered within seconds even if a part does not respond."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping

from pipeline.errors import ImpastoError

TIMEOUT_S = 4.0

Check = Callable[[], None]
"""Raises ImpastoError or OSError if the part does not work."""


class HealthChecks:
    """Checks all parts at the same time. A part whose check has not ended is not checked again."""

    def __init__(self, parts: Mapping[str, Check]) -> None:
        self._parts = dict(parts)
        self._asking: dict[str, _PendingCheck] = {}
        self._lock = threading.Lock()

    def verdicts(self) -> dict[str, str]:
        """Part -> "ok" or the error."""
        with self._lock:
            for name, check in self._parts.items():
                if name not in self._asking or self._asking[name].answered.is_set():
                    self._asking[name] = _PendingCheck(check)
            asked = dict(self._asking)
        deadline = time.monotonic() + TIMEOUT_S
        return {name: question.verdict(deadline) for name, question in asked.items()}


class _PendingCheck:
    def __init__(self, check: Check) -> None:
        self.answered = threading.Event()
        self._began = time.monotonic()
        self._status = ""
        threading.Thread(target=self._ask, args=(check,), name="impasto-check", daemon=True).start()

    def _ask(self, check: Check) -> None:
        try:
            check()
            self._status = "ok"
        except (ImpastoError, OSError) as error:
            self._status = str(error)
        except Exception as error:
            self._status = f"{type(error).__name__}: {error}"
        self.answered.set()

    def verdict(self, deadline: float) -> str:
        if self.answered.wait(max(0.0, deadline - time.monotonic())):
            return self._status
        return f"No answer for {time.monotonic() - self._began:.0f} s."
