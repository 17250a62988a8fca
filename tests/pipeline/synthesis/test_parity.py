"""Kernels agree with the reference implementation bit for bit: odd sizes, every term, one to three iterations."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest

from pipeline.compute import device
from pipeline.synthesis.bands import BandedOperations, bands
from pipeline.synthesis.energy import Energy
from pipeline.synthesis.images import NOWHERE, StyleImage, Target, packed
from pipeline.synthesis.opencl import OpenCLOperations
from pipeline.synthesis.operations import Operations, Search
from pipeline.synthesis.reference import ReferenceOperations
from pipeline.synthesis.refine import FARTHEST_PX, Rounds, refine

pytestmark = pytest.mark.real("opencl")

PLAIN = Energy(guides=(4.0, 0.5, 0.5))
FULL = replace(PLAIN, w_sc=15.0, w_tc=2.0, kept_cost=0.8, w_h=100.0, h_limit=0.5, w_dt=20.0)
ENERGIES = {
    "plain": PLAIN,
    "one guide": Energy(guides=(2.0,)),
    "eight guides": Energy(guides=(1.0,) * 8, w_sc=5.0),
    "as many guides as EbSynth": Energy(guides=(1.0,) * 27, w_sc=5.0),
    "most guides, with opacity": Energy(colours=4, guides=(0.5,) * 28, radius=7),
    "coherent": replace(PLAIN, w_sc=15.0),
    "temporal": replace(PLAIN, w_tc=2.0),
    "histogram": replace(PLAIN, w_h=100.0, h_limit=0.5),
    "lines": replace(PLAIN, w_dt=20.0),
    "change": replace(PLAIN, w_din=1.0, w_dout=0.5),
    "all": replace(FULL, w_din=1.0, w_dout=0.5),
    "small patch": replace(FULL, radius=2),
    "large patch": replace(FULL, radius=6),
}


def smooth(rng: np.random.Generator, height: int, width: int, channels: int) -> np.ndarray:
    noise = rng.integers(0, 256, (height, width, channels), dtype=np.uint8)
    return np.asarray(cv2.GaussianBlur(noise, (0, 0), 1.2)).reshape(height, width, channels)


def random_style(energy: Energy, rotate: bool, masked: bool) -> StyleImage:
    rng = np.random.default_rng(3)
    colours, guides = smooth(rng, 37, 45, energy.colours), smooth(rng, 37, 45, len(energy.guides))
    bins = rng.integers(0, 64, (37, 45), dtype=np.uint8)
    bins[:5] = 255
    usable = (rng.random((37, 45)) < 0.8).astype(np.uint8) if masked else None
    distance = rng.random((37, 45), np.float32) * 20 if energy.w_dt else None
    return StyleImage(colours, packed(energy, colours, guides), bins if rotate else None, usable, distance)


def random_target(energy: Energy, rotate: bool, seed: int = 4) -> Target:
    rng = np.random.default_rng(seed)
    bins = rng.integers(0, 64, (23, 31), dtype=np.uint8) if rotate else None
    distance = rng.random((23, 31), np.float32) * 20 if energy.w_dt else None
    return Target(smooth(rng, 23, 31, len(energy.guides)), bins, distance)


def random_motion() -> np.ndarray:
    return (np.random.default_rng(5).random((23, 31, 2), np.float32) - np.float32(0.5)) * np.float32(4)


def run_operations(
    ops: Operations[Any], energy: Energy, rotate: bool, masked: bool, rounds: int,
    settles: bool = False, votes: bool = False,
) -> dict[str, np.ndarray]:  # fmt: skip
    """Results of every operation, and of `rounds` iterations, with all data that the energy needs."""
    style = ops.load(random_style(energy, rotate, masked), energy)
    before, now = (
        ops.prepare(style, random_target(energy, rotate, 7)),
        ops.prepare(style, random_target(energy, rotate)),
    )
    visible = (np.random.default_rng(6).random((23, 31)) < 0.8).astype(np.uint8)
    old = ops.random_offsets(style, before.size, (1, 2))
    advected = ops.advect(style, now, old, before.bins, ops.upload(random_motion()), ops.upload(visible))
    offsets = ops.merge(style, now.size, advected, ops.random_offsets(style, now.size, (3, 4)), 0.5, (5, 6))
    found = {"old": old, "advected": advected, "merged": offsets}
    if energy.w_tc:
        now.advected = advected
        now.advected_colours = found["before"] = ops.colours_at(style, now.size, advected)
    if energy.has_change_terms:
        guides = random_target(energy, rotate, 7).guides
        ops.add_change(style, now, advected, guides, ops.upload(visible))
        ribbons = np.stack([random_motion() * 8 + 20, random_motion() * 6 + 15])
        ribbons[:, :4] = NOWHERE
        now.ribbons = ops.upload(ribbons)
        fixed = np.full((23, 31, 2), NOWHERE, np.float32)
        fixed[3:9, 5:11] = 7.0
        now.fixed = ops.upload(fixed)
    found["offsets"] = offsets = refine(ops, style, now, offsets, (7, 8), Rounds(rounds, 24.0, settles, votes=votes))
    if energy.w_h:
        found["penalty"] = ops.penalty(style, now.size, offsets)
    fine = ops.load(random_style(energy, rotate, False), energy)
    finer = replace(now, size=(61, 46))
    fraction = ops.upload(ops.fetch(offsets) + random_motion() / np.float32(8))
    found["antialiased"] = ops.antialiased(style, now, fraction, None)
    found["antialiased inside"] = ops.antialiased(style, now, fraction, ops.upload(visible))
    found["upsampled"] = ops.upsample(style, now, offsets, fine, finer)
    return {name: ops.fetch(array) for name, array in found.items()}


def check_parity(
    energy: Energy, rotate: bool, masked: bool, rounds: int, ops: Operations[Any] | None = None,
    settles: bool = False, votes: bool = False,
) -> None:  # fmt: skip
    kernels = run_operations(ops or OpenCLOperations(device()), energy, rotate, masked, rounds, settles, votes)
    reference = run_operations(ReferenceOperations(), energy, rotate, masked, rounds, settles, votes)
    for name, expected in reference.items():
        np.testing.assert_array_equal(kernels[name], expected, err_msg=name)


@pytest.mark.parametrize("pixels", [1, 31 * 20, 31 * 23])
def test_bands_of_rows_give_the_bytes_of_the_whole_frame(pixels: int) -> None:
    check_parity(ENERGIES["all"], True, True, 2, BandedOperations(device(), pixels))


@pytest.mark.parametrize("energy", ["plain", "all"])
def test_kernels_and_bands_equal_the_reference_where_settled_pixels_are_left_out(energy: str) -> None:
    check_parity(ENERGIES[energy], False, False, 6, settles=True)
    check_parity(ENERGIES[energy], False, False, 6, BandedOperations(device(), 31 * 20), settles=True)


@pytest.mark.parametrize("rotate", [False, True])
@pytest.mark.parametrize(
    "energy", [*(ENERGIES[name] for name in ("plain", "all", "small patch")), replace(PLAIN, radius=3)]
)
def test_kernels_and_bands_equal_the_reference_where_overlapping_patches_vote(energy: Energy, rotate: bool) -> None:
    check_parity(energy, rotate, False, 3, votes=True)
    check_parity(energy, rotate, False, 3, BandedOperations(device(), 31 * 20), votes=True)


def test_overlapping_patches_vote_with_the_mean_of_what_they_show() -> None:
    """One of the 25 patches that count shows another part of the style."""
    for ops in (ReferenceOperations(), OpenCLOperations(device())):
        source = random_style(PLAIN, False, False)
        style = ops.load(source, PLAIN)
        state = ops.prepare(style, random_target(PLAIN, False))
        y, x = np.mgrid[6:29, 8:39].astype(np.float32)
        offsets = np.stack([x, y], -1)
        offsets[8, 12] = (30, 20)
        ops.render(style, state, ops.upload(offsets), votes=True)
        shape = (23 + 2 * PLAIN.radius, 31 + 2 * PLAIN.radius, PLAIN.channels)
        found = ops.fetch(state.packed).reshape(-1)[: np.prod(shape)].reshape(shape)[4:-4, 4:-4, :3]
        colours = source.features[..., :3].astype(int)
        assert (found[12, 20] == colours[18, 28]).all(), "all patches agree"
        expected = (24 * colours[16, 18] + colours[22, 28] + 12) // 25
        assert (found[10, 10] == expected).all(), "the patch at (12, 8) shows (28, 22) here"


@pytest.mark.parametrize("rotate", [False, True])
def test_paint_with_opacity_is_antialiased_to_the_bytes_of_the_reference(rotate: bool) -> None:
    energy = replace(PLAIN, colours=4)
    check_parity(energy, rotate, False, 1)


def test_advected_offsets_are_preferred_and_their_fraction_continues_below_a_factor_of_1() -> None:
    """Whole offsets in the pixels of the advected ones get their fraction, and more of them are kept."""
    shares, fractions = [], []
    for kept_cost in (1.0, 0.5):
        ops, energy = OpenCLOperations(device()), replace(PLAIN, w_tc=0.01, kept_cost=kept_cost)
        style = ops.load(random_style(energy, False, False), energy)
        state = ops.prepare(style, random_target(energy, False))
        positions = np.random.default_rng(8).random((23, 31, 2), np.float32) * np.float32(30) + np.float32(2)
        state.advected = ops.upload(positions)
        state.advected_colours = ops.colours_at(style, state.size, state.advected)
        found = ops.fetch(refine(ops, style, state, ops.upload(np.rint(positions)), (7, 8), Rounds(1, 24.0)))
        kept = (np.rint(found) == np.rint(positions)).all(-1)
        shares.append(kept.mean())
        fractions.append((found[kept] == positions[kept]).mean())
    assert shares[1] > 1.5 * shares[0]
    assert fractions == [0.0, 1.0]


def test_pixels_around_which_nothing_has_changed_keep_their_offsets() -> None:
    energy = replace(PLAIN, w_sc=5.0)
    for ops in (ReferenceOperations(), OpenCLOperations(device())):
        style = ops.load(random_style(energy, False, False), energy)
        state = ops.prepare(style, random_target(energy, False))
        start = ops.random_offsets(style, state.size, (1, 2))
        ops.render(style, state, start)
        changed = np.array(ops.fetch(start))
        changed[10, 20, 0] += 1
        state.before = ops.upload(changed)
        found = ops.fetch(ops.improve(style, state, start, None, Search((1, 2), 1, 4, 0.0)))
        moved = np.argwhere((found != ops.fetch(start)).any(-1))
        near = {(10, 20), (9, 20), (11, 20), (10, 19), (10, 21), (6, 20), (14, 20), (10, 16), (10, 24)}
        assert len(moved) and {(int(y), int(x)) for y, x in moved} <= near


@pytest.mark.parametrize(("pixels", "expected"), [(100 * 90, 1), (100 * 46, 3), (100 * 17, 90), (1, 90)])
def test_bands_cover_every_row_once_and_fit_into_memory(pixels: int, expected: int) -> None:
    found = list(bands((100, 90), pixels))
    assert [row for start, stop in found for row in range(start, stop)] == list(range(90)) and len(found) == expected
    if 1 < expected < 90:
        assert all((stop - start + 2 * FARTHEST_PX) * 100 <= pixels for start, stop in found)


@pytest.mark.parametrize("rotate", [False, True], ids=["not rotated", "rotated"])
@pytest.mark.parametrize("energy", ENERGIES.values(), ids=ENERGIES.keys())
def test_kernels_equal_the_reference(energy: Energy, rotate: bool) -> None:
    check_parity(energy, rotate, masked=energy.has_change_terms, rounds=2)


@pytest.mark.parametrize("rounds", [1, 3])
def test_kernels_equal_the_reference_after_several_iterations(rounds: int) -> None:
    check_parity(ENERGIES["all"], True, True, rounds)


def test_a_crop_of_the_style_is_found_at_its_position() -> None:
    ops, energy = ReferenceOperations(), replace(PLAIN, w_sc=5.0)
    source = random_style(energy, False, False)
    style = ops.load(source, energy)
    state = ops.prepare(style, Target(np.ascontiguousarray(source.features[6:29, 8:39, 3:6])))
    offsets = refine(ops, style, state, ops.random_offsets(style, state.size, (1, 1)), (1, 2), Rounds(8, 40.0))
    y, x = np.mgrid[6:29, 8:39]
    assert (np.rint(offsets) == np.stack([x, y], -1)).all(-1).mean() > 0.9
