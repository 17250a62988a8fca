"""Optical flow: known motions, and kernels that equal their reference bit by bit."""

from __future__ import annotations

import threading
from typing import get_args

import cv2
import numpy as np
import pytest

from pipeline.compute import device, report
from pipeline.errors import BadFrame, BadParameter
from pipeline.perception.flow import FlowMethod, TvL1, estimate
from pipeline.perception.flow.dis import PRESETS, Preset, dis
from pipeline.perception.flow.tvl1 import tvl1
from tests.pipeline.perception.flow import truth

METHODS = get_args(FlowMethod)


def pair(height: int, width: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Smooth noise, and the same moved by (2, 1) px."""
    noise = np.random.default_rng(seed).integers(0, 255, (height + 8, width + 8), dtype=np.uint8)
    big = cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 2), None, 0, 255, cv2.NORM_MINMAX)
    return big[4:-4, 4:-4].copy(), big[3:-5, 2:-6].copy()


@pytest.mark.real("opencl")
@pytest.mark.parametrize("method", METHODS)
def test_a_shift_is_found_with_the_right_sign(method: FlowMethod) -> None:
    previous, current = pair(61, 83)
    flow = estimate(previous, current, method)
    assert (flow.shape, flow.dtype) == ((61, 83, 2), np.float32)
    np.testing.assert_allclose(np.median(flow, axis=(0, 1)), [2, 1], atol=0.15)


@pytest.mark.real("opencl")
@pytest.mark.parametrize("method", METHODS)
def test_colour_and_gray_frames_give_the_same_flow(method: FlowMethod) -> None:
    previous, current = pair(48, 64)
    colour = [np.repeat(picture[..., None], 3, axis=2) for picture in (previous, current)]
    np.testing.assert_array_equal(estimate(*colour, method), estimate(previous, current, method))


@pytest.mark.real("opencl")
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("size", [(16, 16), (17, 131), (131, 17), (16, 400)], ids=str)
def test_any_size_is_accepted(method: FlowMethod, size: tuple[int, int]) -> None:
    flow = estimate(*pair(*size), method)
    assert flow.shape == (*size, 2) and np.isfinite(flow).all()


@pytest.mark.parametrize(("preset", "within_px"), [("half", 0.3), ("sparse", 0.4)])
@pytest.mark.parametrize("size", [(16, 16), (17, 131), (131, 17), (16, 400), (61, 83)], ids=str)
def test_the_presets_between_fast_and_medium_find_a_shift_at_any_size(
    size: tuple[int, int], preset: Preset, within_px: float
) -> None:  # fmt: skip
    flow = dis(*pair(*size), preset)
    assert flow.shape == (*size, 2)
    np.testing.assert_allclose(np.median(flow, axis=(0, 1)), [2, 1], atol=within_px)


@pytest.mark.real("opencl")
@pytest.mark.parametrize("method", METHODS)
def test_flat_and_equal_frames_do_not_move(method: FlowMethod) -> None:
    flat = np.full((40, 56), 128, np.uint8)
    assert np.abs(estimate(flat, flat, method)).max() < 1e-3
    assert np.abs(estimate(*[pair(40, 56)[0]] * 2, method)).max() < 0.05


@pytest.mark.real("opencl")
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("name", "bound_px"), [("shapes", 0.45), ("harbour", 0.45)])
def test_the_exact_flow_of_a_scene_is_found(method: FlowMethod, name: str, bound_px: float) -> None:
    known = truth.of_scene(name)
    assert known.error_px(estimate(known.previous, known.current, method)) < bound_px


@pytest.mark.parametrize("preset", PRESETS)
def test_dis_does_not_depend_on_the_number_of_threads(preset: str) -> None:
    previous, current = pair(90, 161)
    before = cv2.getNumThreads()
    try:
        flows = []
        for threads in (1, 2, 5):
            cv2.setNumThreads(threads)
            flows.append(dis(previous, current, preset))  # type: ignore[arg-type]
    finally:
        cv2.setNumThreads(before)
    assert all(np.array_equal(flows[0], other) for other in flows)


def test_dis_does_not_depend_on_earlier_calls() -> None:
    previous, current = pair(60, 80)
    first = dis(previous, current)
    dis(*pair(131, 97))
    np.testing.assert_array_equal(dis(previous, current), first)


def test_dis_may_be_called_from_many_threads() -> None:
    pairs = [pair(60, 80, seed) for seed in range(4)]
    alone = [dis(*p) for p in pairs]
    results: dict[int, bool] = {}

    def work(number: int) -> None:
        results[number] = all(np.array_equal(dis(*pairs[number]), alone[number]) for _ in range(10))

    threads = [threading.Thread(target=work, args=(n,)) for n in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert results == dict.fromkeys(range(4), True)


@pytest.mark.real("opencl")
@pytest.mark.parametrize("size", [(33, 47), (67, 53)], ids=str)
@pytest.mark.parametrize("count", [1, 2, 3])
def test_the_kernels_give_the_bits_of_the_reference(size: tuple[int, int], count: int) -> None:
    previous, current = pair(*size)
    params = TvL1(warps=count, iterations=count, texture_iterations=count)
    specified = tvl1(previous, current, params)
    for row in report(fresh=False):
        if row["works"] and row["kind"] == "cpu":
            got = tvl1(previous, current, params, device(str(row["platform"])))
            np.testing.assert_array_equal(got, specified, err_msg=str(row["platform"]))


@pytest.mark.real("opencl")
@pytest.mark.parametrize("change", [{"texture_iterations": 0}, {"median": False}, {"texture_share": 0.5}], ids=str)
def test_the_kernels_equal_the_reference_with_each_option(change: dict[str, float]) -> None:
    previous, current = pair(35, 49)
    params = TvL1(warps=2, iterations=4).model_copy(update=change)
    np.testing.assert_allclose(tvl1(previous, current, params, device()), tvl1(previous, current, params), atol=1e-5)
    assert not np.array_equal(tvl1(previous, current, params), tvl1(previous, current, TvL1(warps=2, iterations=4)))


@pytest.mark.real("opencl")
@pytest.mark.real("media")
@pytest.mark.parametrize(("name", "bound_px"), [("rubber_whale", 0.12), ("alley", 0.25)])
def test_tvl1_is_accurate_on_measured_flow(name: str, bound_px: float) -> None:
    known = getattr(truth, name)()
    error = known.error_px(estimate(known.previous, known.current, "tvl1"))
    others = {m: round(known.error_px(estimate(known.previous, known.current, m)), 3) for m in METHODS if m != "tvl1"}
    print(f"{name}: mean end-point error {error:.3f} px; {others}")
    assert error < bound_px and error < min(others.values())


@pytest.mark.real("opencl")
@pytest.mark.real("media")
def test_tvl1_is_better_than_opencvs() -> None:
    known = truth.rubber_whale().crop(slice(60, 260), slice(120, 360))
    grays = [cv2.cvtColor(f, cv2.COLOR_RGB2GRAY) for f in (known.previous, known.current)]
    theirs = known.error_px(cv2.optflow.DualTVL1OpticalFlow_create().calc(*grays, None))
    ours = known.error_px(estimate(known.previous, known.current, "tvl1"))
    print(f"RubberWhale, a part: mean end-point error {ours:.3f} px, OpenCV's DualTVL1 {theirs:.3f}")
    assert ours < 0.8 * theirs


def test_an_invalid_picture_is_named() -> None:
    good = np.zeros((32, 32, 3), np.uint8)
    for bad in (good.astype(float), good[:8], good[..., :2], np.zeros((8, 32), np.uint8), np.zeros((32, 32)), "x"):
        with pytest.raises(BadFrame) as caught:
            estimate(good, bad)
        assert caught.value.field == "current"
    with pytest.raises(BadFrame, match="same size"):
        estimate(good, np.zeros((32, 33, 3), np.uint8))
    with pytest.raises(BadParameter, match="dis-fast"):
        estimate(good, good, "farneback")  # type: ignore[arg-type]
