"""Colour scheme replacement: equations 1 to 3, circular hue, statistics, invalid input."""

import json
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.colour.scheme import (
    ColourStats,
    Tone,
    ToneTracker,
    apply,
    from_histogram,
    hue_table,
    learn,
    measure,
)
from pipeline.colour.spaces import hsv_to_srgb, srgb_to_hsv, to_8bit
from pipeline.errors import BadInput
from pipeline.frames import Frame


def stats(peaks: dict[int, float], tone: Tone = Tone(0.5, 0.2, 0.5)) -> ColourStats:
    hue = np.zeros(360)
    for degree, weight in peaks.items():
        hue[degree] = weight
    return ColourStats(tone.saturation_mean, tone.saturation_std, tone.value_mean, hue / max(hue.sum(), 1))


def flat(hsv: tuple[float, float, float], size: tuple[int, int] = (32, 24)) -> Frame:
    colour = to_8bit(hsv_to_srgb(np.array([hsv])))[0]
    return np.broadcast_to(colour, (size[1], size[0], 3)).copy()


def distance(a: NDArray[Any], b: float) -> NDArray[np.float64]:
    return np.abs((a.astype(np.float64) - b + 180) % 360 - 180)


# --- eq. 1


def test_one_step_is_the_weighted_mean_of_the_neighbourhood() -> None:
    table = hue_table(stats({100: 3, 110: 1, 140: 50}), k=1)
    assert table[105] == pytest.approx((100 * 3 + 110) / 4)
    assert table[90] == pytest.approx(100), "110 is 20 degrees away, outside 15 to either side"


def test_steps_are_iterated() -> None:
    """90 is the only peak near 80; 90 and 104 are near 90, with the mean 97; then both are near again."""
    peaks = stats({90: 1, 104: 1})
    assert [float(hue_table(peaks, k=k)[80]) for k in (0, 1, 2, 3)] == pytest.approx([80, 90, 97, 97])


def test_hue_is_circular() -> None:
    table = hue_table(stats({358: 1, 4: 1}))
    assert distance(table[[350, 355, 0, 1, 10]], 1).max() < 1e-4
    assert ((table >= 0) & (table < 360)).all()


def test_rotating_the_histogram_rotates_the_table() -> None:
    rng = np.random.default_rng(0)
    hue = rng.random(360) ** 4
    for turn in (1, 77, 200):
        here = hue_table(ColourStats(0, 0, 0, hue))
        there = hue_table(ColourStats(0, 0, 0, np.roll(hue, turn)))
        assert distance(np.roll(here, turn) + turn - there, 0).max() < 1e-3


def test_peaks_attract_and_more_steps_come_closer() -> None:
    degrees = np.arange(360)
    peak = np.exp(-(((degrees - 200) / 12) ** 2))
    reference = ColourStats(0, 0, 0, peak / peak.sum())
    before = distance(degrees.astype(np.float32), 200)
    once, thrice = (distance(hue_table(reference, k=k), 200) for k in (1, 3))
    near = before < 30
    assert (once[near] <= before[near] + 1e-4).all()
    assert (thrice[near] <= once[near] + 1e-4).all()
    assert thrice[near].mean() < before[near].mean() / 2


def test_an_empty_neighbourhood_leaves_the_hue_alone() -> None:
    table = hue_table(stats({200: 1}))
    np.testing.assert_array_equal(table[:185], np.arange(185))
    assert table[185] == 200
    np.testing.assert_array_equal(hue_table(stats({})), np.arange(360))


def test_a_flat_histogram_changes_no_hue() -> None:
    table = hue_table(ColourStats(0, 0, 0, np.full(360, 1 / 360)))
    assert distance(table - np.arange(360, dtype=np.float32), 0).max() < 1e-4


# --- eq. 2 and 3


def test_saturation_and_value_by_hand() -> None:
    reference = stats({}, Tone(0.6, 0.1, 0.4))
    frame = Tone(0.3, 0.2, 0.8)
    target = apply(reference, frame, [[40.0, 0.5, 0.9]], lambda_=2 / 3)
    assert target[0, 0] == 40.0
    assert target[0, 1] == pytest.approx(0.6 + (0.5 - 0.3) * 0.1 / 0.2)
    assert target[0, 2] == pytest.approx(0.9 * (2 / 3 + 1 / 3 * 0.4 / 0.8))


def test_a_reference_equal_to_the_frame_changes_nothing() -> None:
    colours = np.array([[12.3, 0.5, 0.5], [359.7, 0.05, 1.0], [180.0, 1.0, 0.0]])
    tone = Tone(0.4, 0.2, 0.5)
    np.testing.assert_allclose(apply(stats({}, tone), tone, colours), colours, atol=1e-12)


def test_mean_and_deviation_of_saturation_match_the_reference() -> None:
    rng = np.random.default_rng(1)
    colours = np.column_stack([rng.random(500) * 360, rng.normal(0.4, 0.05, 500), rng.random(500)])
    frame = Tone(float(colours[:, 1].mean()), float(colours[:, 1].std()), 0.5)
    target = apply(stats({}, Tone(0.6, 0.1, 0.5)), frame, colours, achromatic=0)
    assert target[:, 1].mean() == pytest.approx(0.6, abs=2e-3)
    assert target[:, 1].std() == pytest.approx(0.1, abs=2e-3)


def test_lambda_one_keeps_brightness_and_black_stays_black() -> None:
    reference, frame = stats({}, Tone(0.5, 0.2, 0.9)), Tone(0.5, 0.2, 0.3)
    colours = [[0.0, 0.5, 0.3], [0.0, 0.5, 0.0]]
    np.testing.assert_allclose(apply(reference, frame, colours, 1.0)[:, 2], [0.3, 0.0])
    np.testing.assert_allclose(apply(reference, frame, colours, 0.0)[:, 2], [0.9, 0.0])


def test_a_gray_region_stays_gray_unless_achromatic_is_zero() -> None:
    reference, frame = stats({30: 1}, Tone(0.8, 0.1, 0.5)), Tone(0.4, 0.2, 0.5)
    gray = [[30.0, 0.0, 0.9]]
    assert apply(reference, frame, gray)[0, 1] == 0
    assert apply(reference, frame, gray, achromatic=0)[0, 1] == pytest.approx(0.8 - 0.4 / 2)


def test_targets_are_clipped_and_finite_even_for_a_flat_black_frame() -> None:
    reference = stats({10: 1}, Tone(0.9, 0.5, 1.0))
    target = apply(reference, measure(np.zeros((16, 16, 3), np.uint8)), [[350.0, 1.0, 1.0], [5.0, 0.9, 0.01]])
    assert np.isfinite(target).all()
    assert (target[:, 1:] >= 0).all()
    assert (target[:, 1:] <= 1).all()


def test_hue_is_interpolated_between_degrees_and_across_zero() -> None:
    reference, tone = stats({358: 1, 4: 1}), Tone(0.5, 0.2, 0.5)
    hues = np.array([359.5, 359.99, 0.0, 360.0, 0.25])
    target = apply(reference, tone, np.column_stack([hues, np.full((5, 2), 0.5)]))
    assert distance(target[:, 0].astype(np.float32), 1).max() < 1e-3


def test_no_regions_give_no_colours() -> None:
    assert apply(stats({0: 1}), Tone(0.5, 0.2, 0.5), np.empty((0, 3))).shape == (0, 3)


# --- what is counted


def test_gray_and_dark_pixels_have_no_hue() -> None:
    frame = flat((200, 0.9, 0.8))
    frame[:8] = flat((100, 0.1, 0.9))[:8]
    frame[8:16] = flat((20, 0.9, 0.1))[:8]
    learnt = learn([frame])
    assert learnt.hue[198:203].sum() == pytest.approx(1)


def test_dark_pixels_count_for_value_only() -> None:
    frame = flat((200, 0.5, 0.8))
    frame[:12] = flat((20, 1.0, 0.1))[:12]
    tone = measure(frame)
    assert tone.saturation_mean == pytest.approx(0.5, abs=0.01)
    assert tone.saturation_std == pytest.approx(0, abs=0.01)
    assert tone.value_mean == pytest.approx(0.45, abs=0.01)


def test_statistics_are_summed_over_all_frames() -> None:
    half = [flat((40, 0.6, 0.9)), flat((220, 0.2, 0.3))]
    learnt = learn(iter(half))
    assert learnt.hue[38:43].sum() == pytest.approx(0.5)
    assert learnt.hue[218:223].sum() == pytest.approx(0.5)
    assert learnt.saturation_mean == pytest.approx(0.4, abs=0.01)
    assert learnt.saturation_std == pytest.approx(0.2, abs=0.01)
    assert learnt.value_mean == pytest.approx(0.6, abs=0.01)


def test_large_frames_are_sampled_evenly() -> None:
    rng = np.random.default_rng(2)
    small = rng.integers(0, 256, (90, 160, 3), np.uint8)
    large = np.repeat(np.repeat(small, 8, axis=0), 8, axis=1)
    exact, sampled = measure(small), measure(large)
    assert sampled.saturation_mean == pytest.approx(exact.saturation_mean, abs=0.01)
    assert sampled.value_mean == pytest.approx(exact.value_mean, abs=0.01)


def test_a_gray_reference_removes_colour() -> None:
    learnt = learn([np.full((20, 20, 3), 128, np.uint8)])
    assert not learnt.hue.any()
    target = apply(learnt, Tone(0.5, 0.2, 0.5), [[77.0, 0.5, 0.5]])
    assert target[0, 0] == 77
    assert target[0, 1] == 0


def test_a_reference_without_frames_is_rejected() -> None:
    with pytest.raises(BadInput, match="no frames"):
        learn(iter([]))


def test_a_picture_takes_the_hue_of_the_reference() -> None:
    """End to end: an orange and a green region with a reference that is all reddish orange."""
    reference = learn([flat((20, 0.7, 0.8))])
    regions = srgb_to_hsv(np.array([[0.9, 0.5, 0.2], [0.2, 0.8, 0.3]]))
    target = apply(reference, Tone(0.7, 0.1, 0.8), regions)
    assert target[0, 0] == pytest.approx(20, abs=1.5)
    assert target[1, 0] == pytest.approx(regions[1, 0]), "nothing in the reference is near green"


# --- smoothing over time


def test_tone_is_smoothed_with_the_half_life_and_reset_at_a_cut() -> None:
    tracker = ToneTracker(half_life_frames=2)
    tracker.step(Tone(0, 0, 0))
    tracker.step(Tone(1, 1, 1))
    assert tracker.step(Tone(1, 1, 1)).saturation_mean == pytest.approx(0.5)
    assert tracker.step(Tone(0.2, 0.3, 0.4), cut=True) == Tone(0.2, 0.3, 0.4)


def test_half_life_zero_does_not_smooth() -> None:
    tracker = ToneTracker(0)
    tracker.step(Tone(0, 0, 0))
    assert tracker.step(Tone(0.1, 0.2, 0.3)) == Tone(0.1, 0.2, 0.3)


def test_a_restored_tracker_continues_with_the_same_bytes() -> None:
    rng = np.random.default_rng(3)
    tones = [Tone(*rng.random(3).tolist()) for _ in range(9)]
    first, second = ToneTracker(), ToneTracker()
    second.restore(first.state())
    for tone in tones[:5]:
        first.step(tone)
    second.restore(first.state())
    assert [first.step(t) for t in tones[5:]] == [second.step(t) for t in tones[5:]]


# --- the user's own histogram


def given(**changes: object) -> dict[str, object]:
    return {"hue": [1.0] * 36, "saturation_mean": 0.5, "saturation_std": 0.2, "value_mean": 0.6} | changes


def test_a_histogram_of_36_weights_keeps_its_peaks() -> None:
    weights = [0.0] * 36
    weights[12], weights[0] = 2.0, 1.0
    made = from_histogram(given(hue=weights))
    assert made.hue.argmax() == 120
    assert made.hue[355] == pytest.approx(made.hue[5])
    assert made.hue.sum() == pytest.approx(1)


def test_learnt_stats_survive_json() -> None:
    learnt = learn([flat((40, 0.6, 0.9))])
    again = from_histogram(json.loads(json.dumps(learnt.as_json())))
    np.testing.assert_allclose(again.hue, learnt.hue)
    assert again.saturation_mean == learnt.saturation_mean


@pytest.mark.parametrize(
    ("data", "field"),
    [
        ([1, 2], "reference"),
        ({"hue": [1] * 36}, "reference.saturation_mean"),
        (given(extra=1), "reference.extra"),
        (given(hue=[1.0] * 35), "reference.hue"),
        (given(hue="red"), "reference.hue"),
        (given(hue=[0.0] * 36), "reference.hue"),
        (given(hue=[1.0] * 35 + [-1.0]), "reference.hue[35]"),
        (given(hue=[float("nan")] + [1.0] * 35), "reference.hue[0]"),
        (given(hue=[10**400] + [1.0] * 35), "reference.hue[0]"),
        (given(hue=["1"] + [1.0] * 35), "reference.hue[0]"),
        (given(hue=[True] + [1.0] * 35), "reference.hue[0]"),
        (given(saturation_mean=1.5), "reference.saturation_mean"),
        (given(saturation_std=float("inf")), "reference.saturation_std"),
        (given(value_mean=None), "reference.value_mean"),
    ],
)
def test_an_invalid_histogram_is_rejected_with_its_field(data: object, field: str) -> None:
    with pytest.raises(BadInput) as refusal:
        from_histogram(data)
    assert refusal.value.field == field
    assert refusal.value.remedy
