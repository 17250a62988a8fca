"""The cache of previews: limited in bytes; each value is computed once; failed values are not kept."""

from __future__ import annotations

import threading
import weakref
from concurrent.futures import ThreadPoolExecutor

import pytest

from pipeline.errors import Cancelled
from workers.previews.byte_cache import ByteCache

KILOBYTE = b"x" * 1000


def test_the_least_recently_used_values_are_dropped() -> None:
    cache = ByteCache(4000)
    for name in "abcd":
        cache.put(name, KILOBYTE, 1000)
    assert cache.peek("a") is not None
    cache.put("e", KILOBYTE, 1000)
    assert [name for name in "abcde" if cache.peek(name) is None] == ["b"]
    assert cache.size_bytes == 4000


def test_a_value_larger_than_a_quarter_is_given_but_not_kept() -> None:
    cache = ByteCache(2000)
    assert cache.get("a", lambda: KILOBYTE, len) == KILOBYTE
    assert (cache.peek("a"), cache.size_bytes) == (None, 0)


def test_a_value_that_two_threads_ask_for_is_made_once() -> None:
    cache, both, made = ByteCache(8000), threading.Barrier(2), []

    def make() -> bytes:
        made.append(1)
        return KILOBYTE

    def ask() -> bytes:
        both.wait(60)
        return cache.get("a", make, len)

    with ThreadPoolExecutor(2) as threads:
        assert [future.result() for future in [threads.submit(ask), threads.submit(ask)]] == [KILOBYTE, KILOBYTE]
    assert made == [1]


class Key:
    """A key that supports weak references."""


def test_nothing_is_kept_of_a_value_that_was_cancelled() -> None:
    cache, key = ByteCache(8000), Key()
    following = weakref.ref(key)

    def cancelled() -> bytes:
        raise Cancelled("Nobody waits for it.")

    with pytest.raises(Cancelled):
        cache.get(key, cancelled, len)
    del key
    assert following() is None
    assert cache.get("a", lambda: KILOBYTE, len) == KILOBYTE
