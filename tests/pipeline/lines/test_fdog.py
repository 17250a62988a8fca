"""Flow-based difference of Gaussians: kernels equal the reference, known responses, temporal smoothing."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.compute import device, report
from pipeline.errors import BadParameter, DeviceError
from pipeline.frames import Flow, Plane
from pipeline.lines.dog import dog_response
from pipeline.lines.fdog import fdog_response
from pipeline.methods.abstraction import flow_lines
from pipeline.methods.abstraction.flow_lines import FlowLines
from pipeline.methods.abstraction.line_extractor import LineExtractor, PreviousFrame
from pipeline.methods.abstraction.params import AbstractionParams
from pipeline.methods.abstraction.sizes import sizes_of
from pipeline.tensors.structure import structure_tensor, tangent_field

SIGMA, TAU, ALONG = 0.9, 0.99, 2.25
DRAWN = 1.1
"""Response, in gray levels, above which a pixel counts as drawn: the method's default threshold."""


def noise(size: tuple[int, int], seed: int, deviation: float) -> Plane:
    return (np.random.default_rng(seed).standard_normal(size) * deviation).astype(np.float32)


def edge(angle_rad: float, size: tuple[int, int] = (63, 63), height: float = 80) -> Plane:
    """A straight edge through the middle; `angle_rad` is the angle of its normal."""
    return np.asarray(128 + height / 2 * np.tanh(across(angle_rad, size) / 0.7), np.float32)


def across(angle_rad: float, size: tuple[int, int] = (63, 63)) -> NDArray[np.floating]:
    """Signed distance from the edge, px."""
    y, x = np.indices(size) - (np.array(size) - 1).reshape(2, 1, 1) / 2
    return np.asarray(x * math.cos(angle_rad) + y * math.sin(angle_rad))


def tangents(gray: Plane) -> Flow:
    return tangent_field(structure_tensor(gray, 2 * SIGMA))


def fdog(gray: Plane, along: float = ALONG, iterations: int = 1) -> Plane:
    return fdog_response(gray, tangents(gray), SIGMA, TAU, along, None, iterations)


def strokes(drawn: NDArray[np.bool_]) -> tuple[int, int]:
    """Number of connected strokes, and the width of the widest, px."""
    count, _, stats, _ = cv2.connectedComponentsWithStats(drawn.astype(np.uint8), connectivity=8)
    return count - 1, int(stats[1:, cv2.CC_STAT_WIDTH].max(initial=0))


@pytest.mark.real("opencl")
@pytest.mark.parametrize("iterations", [1, 2, 3])
@pytest.mark.parametrize("size", [(37, 53), (17, 16), (1, 9), (9, 1)])
def test_the_kernels_equal_the_reference(size: tuple[int, int], iterations: int) -> None:
    gray = cv2.GaussianBlur(128 + noise(size, 1, 60), (0, 0), 1.2).reshape(size)
    field = tangents(gray)
    specified = fdog_response(gray, field, SIGMA, TAU, ALONG, None, iterations)
    for row in report(fresh=False):
        if row["works"]:
            got = fdog_response(gray, field, SIGMA, TAU, ALONG, device(str(row["platform"])), iterations)
            if row["kind"] == "cpu":
                np.testing.assert_array_equal(got, specified, str(row["platform"]))
            np.testing.assert_allclose(got, specified, atol=1e-3, err_msg=str(row["platform"]))


@pytest.mark.parametrize("degrees", range(0, 180, 15))
def test_a_straight_edge_has_the_response_of_plain_dog_in_any_direction(degrees: int) -> None:
    gray = edge(math.radians(degrees))
    inside = (slice(12, -12), slice(12, -12))
    flow, plain = fdog(gray)[inside], dog_response(gray, SIGMA, TAU)[inside]
    assert 0.82 * plain.max() < flow.max() < 1.02 * plain.max()
    assert np.abs(flow - plain).max() < 0.18 * plain.max()


def test_rotating_the_picture_rotates_the_lines() -> None:
    gray = cv2.GaussianBlur(128 + noise((37, 53), 2, 60), (0, 0), 1.5)
    rotated = fdog(np.ascontiguousarray(np.rot90(gray)))
    # A quarter turn changes roundings, and a nearest pixel that was a tie falls to the other side here and there.
    differs = np.abs(np.rot90(rotated, -1) - fdog(gray)) > 0.01
    assert differs.mean() < 0.02


def test_a_faint_edge_in_noise_gives_one_unbroken_line_where_plain_dog_gives_pieces() -> None:
    angle = math.radians(65)
    gray = cv2.GaussianBlur(edge(angle, (96, 128), 60) + noise((96, 128), 3, 16), (0, 0), 0.8)
    near = np.abs(across(angle, (96, 128))) < 6
    assert strokes((fdog(gray) > DRAWN) & near) == (1, 128)
    count, longest_px = strokes((dog_response(gray, SIGMA, TAU) > DRAWN) & near)
    assert count > 10
    assert longest_px < 64


def test_noise_gives_fewer_specks_than_plain_dog() -> None:
    gray = cv2.GaussianBlur(128 + noise((120, 160), 4, 16), (0, 0), 0.8)
    flow, _ = strokes(fdog(gray) > DRAWN)
    plain, _ = strokes(dog_response(gray, SIGMA, TAU) > DRAWN)
    assert plain > 200
    assert flow < plain / 10


def test_lines_follow_a_curve() -> None:
    y, x = np.indices((61, 61)) - 30.0
    radius = np.hypot(x, y)
    gray = np.asarray(128 + 50 * np.tanh((radius - 12) / 1.5), np.float32)
    response = fdog(gray)
    ring = [response[np.abs(radius - r) < 0.6] for r in (10, 11, 12)]
    strongest = max(ring, key=np.mean)
    assert strongest.min() > 0.7 * strongest.max()
    assert response[radius > 16].max() < 0.5


def test_a_flat_picture_has_no_lines() -> None:
    gray = np.full((20, 30), 200, np.float32)
    np.testing.assert_allclose(fdog(gray), -0.01 * gray, atol=1e-3)


def test_without_averaging_the_response_is_the_difference_across() -> None:
    gray = edge(0.0) + noise((63, 63), 5, 6)
    up = np.zeros((63, 63, 2), np.float32)
    up[..., 1] = 1
    bare = fdog_response(gray, up, SIGMA, TAU, 0)
    row = cv2.GaussianBlur(gray, (9, 1), SIGMA), cv2.GaussianBlur(gray, (9, 1), SIGMA * 1.6)
    np.testing.assert_allclose(bare[:, 8:-8], (TAU * row[1] - row[0])[:, 8:-8], atol=0.2)
    averaged = fdog_response(gray, up, SIGMA, TAU, 3)
    assert averaged[10:-10, 31].std() < 0.5 * bare[10:-10, 31].std()


def test_more_iterations_strengthen_lines_only() -> None:
    gray = edge(0.4)
    once, twice, thrice = (fdog(gray, iterations=n) for n in (1, 2, 3))
    assert once.max() < twice.max() < thrice.max() < 2.5 * once.max()
    assert not (thrice[np.abs(across(0.4)) > 6] > 0).any()
    with pytest.raises(BadParameter, match="iterations"):
        fdog(gray, iterations=0)


def moving(index: int) -> tuple[NDArray[np.uint8], Plane, PreviousFrame]:
    """A noisy disc that moves two pixels a frame, its importance and its flow."""
    frame = np.full((64, 96), 170, np.float32)
    cv2.circle(frame, (30 + 2 * index, 32), 16, 60, -1, cv2.LINE_AA)
    frame = cv2.GaussianBlur(frame + noise(frame.shape, index, 6), (0, 0), 0.8)
    flow = np.zeros((64, 96, 2), np.float32)
    flow[10:54, 10 + 2 * index : 50 + 2 * index, 0] = 2
    past = PreviousFrame(flow, np.zeros((64, 96), np.uint8))
    return frame.clip(0, 255).astype(np.uint8), np.full((64, 96), 0.3, np.float32), past


def test_a_restored_session_continues_with_the_same_bytes() -> None:
    params = AbstractionParams(lines="flow", line_width=9, line_length=10)
    whole, first, second = (LineExtractor(params, sizes_of(params, (96, 64))) for _ in range(3))
    expected = [whole.step(g, w, p if k else None).tobytes() for k, (g, w, p) in enumerate(map(moving, range(5)))]
    for k in range(3):
        gray, weight, past = moving(k)
        first.step(gray, weight, past if k else None)
    second.restore({name: array.copy() for name, array in first.state().items()})
    assert set(first.state()) == {"ink", "tensors"}
    assert [second.step(*moving(k)).tobytes() for k in (3, 4)] == expected[3:]
    forgetful = LineExtractor(params, sizes_of(params, (96, 64)))
    forgetful.restore({"ink": first.state()["ink"]})
    assert forgetful.step(*moving(3)).tobytes() != expected[3]


@pytest.mark.real("opencl")
def test_the_result_is_the_same_without_a_device(monkeypatch: pytest.MonkeyPatch) -> None:
    with_device = FlowLines(SIGMA, TAU, 0.8)
    monkeypatch.setattr(flow_lines, "device", _no_device)
    without = FlowLines(SIGMA, TAU, 0.8)
    assert with_device.device and not without.device
    for k in range(3):
        gray, weight, past = moving(k)
        drawn = [lines.step(gray.astype(np.float32), weight, past.flow) for lines in (with_device, without)]
        np.testing.assert_allclose(drawn[0], drawn[1], atol=0 if with_device.device.kind == "cpu" else 1e-3)


def _no_device() -> None:
    raise DeviceError("There is none.", field="device")


def test_temporal_smoothing_steadies_directions() -> None:
    """The edge is still, faint and noisy."""
    assert trembling(memory=0.85) < 0.3 * trembling(memory=0.0)


def trembling(memory: float) -> float:
    """Mean change of the directions near an edge from one noisy frame to the next, as a sine."""
    lines, weight, still = FlowLines(SIGMA, TAU, memory), np.zeros((63, 63), np.float32), np.zeros((63, 63, 2))
    fields = []
    for k in range(8):
        lines.step(edge(0.5, height=24) + noise((63, 63), k, 5), weight, still.astype(np.float32))
        assert lines.tensors is not None
        fields.append(tangent_field(lines.tensors)[np.abs(across(0.5)) < 2])
    a, b = fields[-2:]
    return float(np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).mean())


def test_dots_are_kept_where_importance_is_high() -> None:
    gray = np.full((41, 41), 180, np.float32)
    cv2.circle(gray, (20, 20), 2, 90, -1, cv2.LINE_AA)
    peaks = []
    for weight in (0.0, 1.0):
        lines = FlowLines(SIGMA, TAU, 0)
        peaks.append(lines.step(gray, np.full_like(gray, weight), None).max())
    assert peaks[1] == pytest.approx(dog_response(gray, SIGMA, TAU).max(), rel=1e-5)
    assert peaks[0] < 0.8 * peaks[1]
