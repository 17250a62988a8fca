"""Background work, immediately without a helper thread and in order with one."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor

import pytest

from pipeline.kernels.executors import FrameExecutor, LazyExecutor


def test_without_a_helper_the_caller_computes_at_once() -> None:
    asked = []
    later = FrameExecutor()(lambda x: asked.append(threading.current_thread()) or x + 1, 1)
    assert asked == [threading.current_thread()]
    assert later.result() == 2


def test_a_helper_thread_works_in_order() -> None:
    background, called, gate = FrameExecutor(), [], threading.Event()
    with ThreadPoolExecutor(1) as background.helper:
        background(gate.wait, 5)
        laters = [background(lambda n: called.append(n) or threading.current_thread(), n) for n in range(5)]
        assert called == []
        gate.set()
        assert {later.result() for later in laters} != {threading.current_thread()}
    assert called == [0, 1, 2, 3, 4]


def test_an_exception_is_raised_where_the_result_is_read() -> None:
    background = FrameExecutor()
    with ThreadPoolExecutor(1) as background.helper, pytest.raises(ZeroDivisionError):
        background(lambda: 1 / 0).result()
    background.helper = None
    with pytest.raises(ZeroDivisionError):
        background(lambda: 1 / 0)


def test_each_row_is_computed_once_and_the_helper_takes_the_upper_half() -> None:
    background, done = FrameExecutor(), []

    def work(first: int, last: int) -> None:
        done.append((first, last, threading.current_thread().name))

    background.rows(work, 7)
    assert done == [(0, 7, threading.current_thread().name)]
    done.clear()
    with ThreadPoolExecutor(1, thread_name_prefix="helper") as background.helper:
        background.rows(work, 7)
    assert sorted((first, last) for first, last, _ in done) == [(0, 3), (3, 7)]
    assert next(name for first, _, name in done if first == 0).startswith("helper")


def test_deferred_functions_run_in_order_in_the_thread_that_asks() -> None:
    background, called = LazyExecutor(), []
    values = [background.submit(lambda n: called.append(n) or threading.current_thread(), n) for n in range(4)]
    assert not called
    with ThreadPoolExecutor(1) as other:
        asking = other.submit(lambda: (values[1].result(), threading.current_thread())).result()
    assert called == [0, 1], "what the value depends on comes first"
    assert asking[0] is asking[1] is values[0].result()
    background.finish()
    assert called == [0, 1, 2, 3]
    assert values[3].result() is threading.current_thread()


def test_an_error_of_a_deferred_function_is_raised_where_its_value_is_asked_for() -> None:
    background = LazyExecutor()
    failed = background.submit(lambda: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        failed.result()
