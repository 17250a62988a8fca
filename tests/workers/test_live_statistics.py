"""Counts and percentiles."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from workers.live.statistics import GROWTH, FrameStatistics, Histogram


@given(st.lists(st.floats(2e-4, 10), min_size=1, max_size=300), st.sampled_from([1, 50, 95, 99, 100]))
def test_percentiles_are_right_to_a_bin(seconds: list[float], percent: int) -> None:
    histogram = Histogram()
    for one in seconds:
        histogram.add(one)
    true = float(np.percentile(seconds, percent, method="inverted_cdf"))
    assert true * (1 - 1e-9) <= histogram.percentile(percent) <= true * GROWTH * (1 + 1e-9)


def test_an_empty_histogram_and_extreme_values_have_finite_percentiles() -> None:
    histogram = Histogram()
    assert histogram.percentile(99) == 0.0
    histogram.add(0.0)
    histogram.add(1e9)
    assert histogram.percentile(100) < 30


def test_statistics_of_one_second() -> None:
    figures = FrameStatistics(10.0, received=4, dropped=1)
    for latency_s in (0.01, 0.02, 0.03):
        figures.answered(latency_s, {"analyze": 0.004, "paint": latency_s})
    report = figures.as_json(11.5)
    assert (report["received"], report["painted"], report["dropped"], report["fps"]) == (4, 3, 1, 2.0)
    assert report["latency_ms"]["p50"] == pytest.approx(20, rel=0.03)
    assert report["stages_ms"] == {"analyze": 4.0, "paint": 20.0}


def test_statistics_without_frames() -> None:
    report = FrameStatistics(0.0).as_json(0.0)
    assert (report["painted"], report["fps"], report["latency_ms"]["p99"]) == (0, 0.0, 0.0)
