"""Device selection, kernels at odd sizes, and error messages."""

from __future__ import annotations

import json
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

from pipeline.compute import Device, choice, device, probe, report
from pipeline.compute.probe import Found
from pipeline.compute.signature import signature
from pipeline.errors import DeviceError

SOURCE = """
kernel void axpy(global const float *x /* width * height */,
                 global float *y /* width * height */, const float a,
                 const int width, const int height)
{
    const int i = get_global_id(0), j = get_global_id(1);
    if (i < width && j < height)
        y[j * width + i] = a * x[j * width + i] + SHIFT;
}
kernel void grow(global float *y /* count */, const int count)
{
    if (get_global_id(0) < count)
        y[get_global_id(0)] += 1.0f;
}
"""


def found(name: str, kind: str = "cpu", fault: str = "", rank: tuple[int, int] = (0, 1)) -> Found:
    return Found("Platform", name, kind, "1.0", rank, fault)


@pytest.fixture
def source(tmp_path: Path) -> Path:
    file = tmp_path / "kernels.cl"
    file.write_text(SOURCE)
    return file


@pytest.fixture
def listed(monkeypatch: pytest.MonkeyPatch) -> list[Found]:
    rows: list[Found] = []
    monkeypatch.setattr(choice, "probe", lambda fresh=False: (rows, "" if rows else "No runtime is registered."))
    return rows


def test_a_working_gpu_is_preferred_to_a_cpu(listed: list[Found]) -> None:
    listed += [found("cpu"), found("broken", "gpu", fault="build failed"), found("card", "gpu")]
    assert choice.choose().device == "card"
    assert choice.choose("cpu").device == "cpu"
    assert choice.choose("CAR").device == "card"


def test_a_requested_device_is_not_replaced_by_another(listed: list[Found]) -> None:
    listed += [found("one"), found("two", fault="build failed")]
    for wanted in ("gpu", "two", "three"):
        with pytest.raises(DeviceError) as caught:
            choice.choose(wanted)
        assert caught.value.value == wanted and caught.value.remedy


def test_the_report_gives_every_device_a_reason(listed: list[Found]) -> None:
    listed += [found("slow"), found("fast", rank=(1, 1)), found("broken", fault="build failed")]
    rows = {row["device"]: row for row in report()}
    assert rows["fast"]["chosen"] and not rows["slow"]["chosen"]
    assert "another one comes first" in str(rows["slow"]["reason"])
    assert "build failed" in str(rows["broken"]["reason"]) and not rows["broken"]["works"]


def test_the_report_states_that_there_are_no_devices(listed: list[Found]) -> None:
    (row,) = report()
    assert not row["works"] and "impasto[cpu]" in str(row["reason"])
    with pytest.raises(DeviceError, match="No runtime is registered"):
        choice.choose()


def lines_of(*rows: Found, announce_only: bool = False) -> list[str]:
    made = [json.dumps(vars(row)) for row in rows]
    return [line for row in made for line in (["?" + row] if announce_only else ["?" + row, row])]


def test_after_a_device_that_kills_its_test_the_next_is_tested(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    calls: list[int] = []

    def child(skip: int, timeout_s: float) -> tuple[list[str], str]:
        calls.append(skip)
        if skip == 0:
            return lines_of(found("a")) + lines_of(found("crash"), announce_only=True), "was killed by signal 11"
        return lines_of(found("b")), ""

    monkeypatch.setattr(probe, "_child", child)
    monkeypatch.setattr(probe.runtime, "cache_folder", lambda: tmp_path)
    asked, ending = probe.probe(fresh=True)
    assert calls == [0, 2] and ending == ""
    assert [(f.device, bool(f.fault)) for f in asked] == [("a", False), ("crash", True), ("b", False)]
    assert "signal 11" in asked[1].fault


def test_a_listing_that_fails_is_tried_once(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(probe.runtime, "cache_folder", lambda: tmp_path)
    monkeypatch.setattr(probe, "_child", lambda skip, timeout_s: ([], "was killed by signal 11"))
    assert probe.probe(fresh=True) == ([], "Listing the OpenCL devices failed: was killed by signal 11.")


def test_a_child_that_hangs_is_ended(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    hang = tmp_path / "hang"
    announced = json.dumps(vars(found("slow")))
    hang.write_text(f"#!/bin/sh\necho '?{announced}'\nexec sleep 60\n")
    hang.chmod(0o755)
    monkeypatch.setattr(probe.sys, "executable", str(hang))
    monkeypatch.setattr(probe.runtime, "cache_folder", lambda: tmp_path)
    monkeypatch.setattr(probe, "TIMEOUT_S", 0.0)  # then one second for the child
    (device,), ending = probe.probe(fresh=True)
    assert "did not end within 1 s" in device.fault and ending == "Testing the OpenCL devices took too long."


@pytest.mark.real("opencl")
def test_test_results_are_cached_and_renewed_on_demand(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(probe.runtime, "cache_folder", lambda: tmp_path)
    asked: list[int] = []
    real = probe._child
    monkeypatch.setattr(probe, "_child", lambda skip, timeout_s: (asked.append(skip), real(skip, timeout_s))[1])
    first = probe.probe()
    assert first == probe.probe() and first[0] and len(asked) >= 1
    count = len(asked)
    probe.probe(fresh=True)
    assert len(asked) > count


@pytest.mark.real("opencl")
@pytest.mark.parametrize("size", [(1, 1), (63, 17), (131, 5)], ids=str)
def test_a_kernel_covers_exactly_the_pixels_of_any_size(source: Path, size: tuple[int, int]) -> None:
    one = device()
    x = np.random.default_rng(0).random((size[1], size[0]), dtype=np.float32)
    y = one.upload(np.full((size[1] + 1, size[0]), -1, np.float32))
    kernel = one.kernel(source, "axpy", {"SHIFT": "1.0f"})
    kernel(size, one.upload(x), y, 0.1, *size)
    got = one.download(y)
    np.testing.assert_array_equal(got[:-1], np.float32(0.1) * x + np.float32(1))  # rounded twice: no fused add
    np.testing.assert_array_equal(got[-1], -1)


@pytest.mark.real("opencl")
def test_a_sequence_of_launches_runs_in_order_and_repeatedly(source: Path) -> None:
    one = device()
    y, x = one.zeros((3, 5)), one.zeros((3, 5))
    grow = one.kernel(source, "grow", {"SHIFT": "0.0f"}).at((15,), y, 15)
    double = one.kernel(source, "axpy", {"SHIFT": "0.0f"}).at((5, 3), y, x, 2.0, 5, 3)
    one.run(grow, double, times=4)
    np.testing.assert_array_equal(one.download(y), 4)
    np.testing.assert_array_equal(one.download(x), 8)


@pytest.mark.real("opencl")
def test_threads_share_a_device(source: Path) -> None:
    one, results = device(), {}

    def work(number: int) -> None:
        y = one.zeros((1000,))
        for _ in range(50):
            one.kernel(source, "grow", {"SHIFT": number})((1000,), y, 1000)
        results[number] = one.download(y)

    threads = [threading.Thread(target=work, args=(n,)) for n in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(results) == 4
    for result in results.values():
        np.testing.assert_array_equal(result, 50)


@pytest.mark.real("opencl")
def test_a_process_has_one_device(source: Path) -> None:
    assert device() is device() and device(device().name.lower()).name


@pytest.mark.real("opencl")
def test_a_build_error_contains_the_build_log(tmp_path: Path) -> None:
    file = tmp_path / "wrong.cl"
    file.write_text("kernel void wrong(global float *y /* 1 */) { y[0] = nonsense; }")
    with pytest.raises(DeviceError, match="nonsense") as caught:
        device().kernel(file, "wrong")
    assert "wrong.cl" in caught.value.message


@pytest.mark.real("opencl")
def test_another_environment_loads_the_same_binaries(source: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """pyopencl finds a binary by its source and options, so these must not have the path of an environment."""
    one = device()
    from pyopencl import cache  # after the device: the first import fixes the list of runtimes
    from pyopencl.characterize import has_src_build_cache

    keys: list[tuple[bytes, str]] = []
    real = cache.get_cache_key
    monkeypatch.setattr(cache, "get_cache_key", lambda where, *key: (keys.append(key), real(where, *key))[1])
    one.kernel(source, "grow", {"SHIFT": "0.125f"})
    assert all(sys.prefix not in str(key) for key in keys)
    assert keys or has_src_build_cache(one._context.devices[0])


@pytest.mark.real("opencl")
def test_unused_memory_is_released(source: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    one = device()
    monkeypatch.setattr("pipeline.compute.opencl._IDLE_BYTES", 1 << 20)
    for side in range(100, 1100, 100):
        one.zeros((side, side, 3))
    one.empty((4,))
    assert one._pool.managed_bytes - one._pool.active_bytes < 20 << 20


@pytest.mark.real("opencl")
def test_every_working_device_gives_the_same_bits(source: Path) -> None:
    x = np.random.default_rng(1).random((33, 65), dtype=np.float32)
    results = []
    for row in report(fresh=False):
        if row["works"]:
            one = device(str(row["platform"]))
            assert isinstance(one, Device)
            y = one.zeros(x.shape)
            one.kernel(source, "axpy", {"SHIFT": "0.3f"})((65, 33), one.upload(x), y, 0.7, 65, 33)
            results.append(one.download(y))
    assert results and all(np.array_equal(results[0], other) for other in results)


@pytest.mark.parametrize(("floats", "works"), [(15, True), (14, False)])
def test_an_array_smaller_than_declared_is_rejected(source: Path, floats: int, works: bool) -> None:
    one = device()
    grow = one.kernel(source, "grow", {"SHIFT": "0.0f"})
    if works:
        grow((15,), one.zeros((floats,)), 15)
        return
    with pytest.raises(DeviceError, match="y of the kernel grow has 56 bytes"):
        grow((15,), one.zeros((floats,)), 15)


def test_sizes_are_sums_products_and_quotients_of_integers_and_names_only() -> None:
    size = "2 * (N // 3 - 1) + (A or B) * M"
    (parameter,) = signature(f"kernel void sized(global float *y /* {size} */)", "sized")
    assert parameter.size is not None
    assert parameter.size({"N": 10, "M": 7, "A": 0, "B": 5}) == 11
    assert parameter.size({"N": 10, "M": "7", "A": 0, "B": 0}) == 4
    with pytest.raises(DeviceError, match="not an arithmetic expression"):
        signature("kernel void odd(global float *y /* N ** 2 */)", "odd")


def test_zeros_of_every_type_and_of_no_elements() -> None:
    one = device()
    for dtype in (np.uint8, np.int16, np.float32):
        one.upload(np.full((5, 7), 3, dtype))  # its memory is used again
        assert np.array_equal(one.download(one.zeros((5, 7), dtype)), np.zeros((5, 7), dtype))
    assert one.download(one.zeros((0, 4))).shape == (0, 4)


def test_a_pointer_without_a_declared_size_is_rejected(tmp_path: Path) -> None:
    file = tmp_path / "bare.cl"
    file.write_text("kernel void bare(global float *y) { y[0] = 1.0f; }")
    with pytest.raises(DeviceError, match="declares no size"):
        device().kernel(file, "bare")
