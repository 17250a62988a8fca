"""Ways in which a library can hang. None of them returns."""

from __future__ import annotations

import ctypes
import hashlib
import re
import time
from collections.abc import Callable


def spin_in_python() -> None:
    while True:
        pass


def spin_in_native_code_with_the_lock() -> None:
    re.match(r"(a+)+$", "a" * 64 + "b")


def spin_in_native_code_without_the_lock() -> None:
    hashlib.pbkdf2_hmac("sha256", b"", b"", 2**31 - 1)


def sleep_in_python() -> None:
    while True:  # the signal for the stacks ends a sleep
        time.sleep(3600)


def sleep_in_native_code_with_the_lock() -> None:
    while True:
        ctypes.PyDLL(None).sleep(3600)


def sleep_in_native_code_without_the_lock() -> None:
    while True:
        ctypes.CDLL(None).sleep(3600)


HANGS: dict[str, Callable[[], None]] = {
    hang.__name__: hang
    for hang in (
        spin_in_python, spin_in_native_code_with_the_lock, spin_in_native_code_without_the_lock,
        sleep_in_python, sleep_in_native_code_with_the_lock, sleep_in_native_code_without_the_lock,
    )
}  # fmt: skip
