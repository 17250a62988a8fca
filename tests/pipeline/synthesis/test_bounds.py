"""Kernels stay inside their arrays: guard bands are unchanged, and results do not depend on bytes outside."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pipeline.compute import device
from pipeline.compute.choice import choose
from pipeline.synthesis.distance import nearest
from pipeline.synthesis.energy import Energy
from pipeline.synthesis.images import Target
from pipeline.synthesis.opencl import OpenCLOperations
from pipeline.synthesis.operations import Operations
from pipeline.synthesis.reference import ReferenceOperations
from pipeline.synthesis.refine import Rounds, refine
from tests.pipeline.compute.guarded import GuardedDevice
from tests.pipeline.synthesis.test_parity import ENERGIES, random_style, random_target, run_operations

pytestmark = pytest.mark.real("opencl")


@pytest.mark.parametrize("rotate", [False, True], ids=["not rotated", "rotated"])
@pytest.mark.parametrize("name", ["plain", "eight guides", "all", "large patch"])
def test_kernels_neither_read_nor_write_outside_their_arrays(name: str, rotate: bool) -> None:
    found = []
    for fill in (0x00, 0xA5):
        guarded = GuardedDevice(choose(), fill)
        ops = OpenCLOperations(guarded)
        found.append(run_operations(ops, ENERGIES[name], rotate, masked=True, rounds=2))
        run_operations(ops, ENERGIES[name], rotate, masked=True, rounds=1, votes=True)
        guarded.check_bands()
    for array in found[0]:
        np.testing.assert_array_equal(found[0][array], found[1][array], err_msg=array)


def test_guard_bands_detect_a_write_outside() -> None:
    guarded = GuardedDevice(choose(), 0)
    mask = np.zeros((5, 7), bool)
    mask[2, 3] = True
    nearest(mask, guarded)
    guarded.check_bands()
    small = guarded.empty((4,))
    outside = small.buffer.get_info(guarded._cl.mem_info.ASSOCIATED_MEMOBJECT)
    guarded._cl.enqueue_copy(guarded._queue, outside, np.ones(1, np.uint8), device_offset=4096 + 16)
    with pytest.raises(Exception, match="outside an array of 16 bytes"):
        guarded.check_bands()


def offsets_with_lines_of_the_target_only(ops: Operations[Any]) -> np.ndarray:
    energy = replace(Energy(guides=(4.0, 0.5, 0.5)), w_dt=20.0)
    style = ops.load(replace(random_style(energy, False, False), distance=None), energy)
    target: Target = random_target(energy, False)
    state = ops.prepare(style, target)
    offsets = refine(ops, style, state, ops.random_offsets(style, state.size, (1, 2)), (3, 4), Rounds(1, 4.0))
    return np.asarray(ops.fetch(offsets))


def test_lines_of_a_frame_are_ignored_if_the_style_has_none() -> None:
    kernels = offsets_with_lines_of_the_target_only(OpenCLOperations(device()))
    np.testing.assert_array_equal(kernels, offsets_with_lines_of_the_target_only(ReferenceOperations()))
