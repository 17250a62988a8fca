"""Trends of a soak run."""

from __future__ import annotations

import threading
from collections import Counter
from pathlib import Path

import numpy as np

from tests.soak.load import failures
from tests.soak.measure import Series, folder_size, trend


def _series(per_hour: float, noise: float) -> Series:
    at_s = [10.0 * index for index in range(200)]
    jitter = np.random.default_rng(1).normal(0, noise, 200)
    return Series(at_s, [100 + per_hour * at / 3600 + shift for at, shift in zip(at_s, jitter, strict=True)])


def test_a_leak_is_told_from_noise() -> None:
    leak, noise = trend(_series(40.0, 1.0)), trend(_series(0.0, 1.0))
    assert leak is not None and noise is not None
    assert leak.grows and abs(leak.per_hour - 40) < 5
    assert not noise.grows


def test_what_fills_up_at_the_start_is_no_growth() -> None:
    series = _series(0.0, 0.5)
    series.values[:40] = [float(value) for value in range(40)]
    found = trend(series)
    assert found is not None and not found.grows


def test_few_samples_have_no_trend() -> None:
    assert trend(Series([0.0, 1.0], [1.0, 2.0])) is None


def test_failures_are_answers_that_blame_the_service_and_failed_jobs() -> None:
    done = Counter({"polls": 3, "fault: GET /: 500": 1, "job of steady: failed": 2, "job of steady: succeeded": 1})
    assert failures(done) == {"fault: GET /: 500": 1, "job of steady: failed": 2}


def test_a_folder_is_measured_while_others_delete_from_it(tmp_path: Path) -> None:
    (tmp_path / "kept").write_bytes(bytes(7))
    over = threading.Event()

    def make_and_delete() -> None:
        while not over.is_set():
            for number in range(20):
                (tmp_path / str(number)).mkdir()
            for number in range(20):
                (tmp_path / str(number)).rmdir()

    other = threading.Thread(target=make_and_delete)
    other.start()
    try:
        assert [folder_size(tmp_path) for _ in range(2000)] == [7] * 2000
    finally:
        over.set()
        other.join()
