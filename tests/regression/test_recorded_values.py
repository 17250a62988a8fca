"""Frames and artefacts equal the recorded ones: changes that should not affect pictures do not."""

from __future__ import annotations

import pytest

from tests.regression import values
from tests.regression.cases import CASES
from tests.regression.pinned import OPENCL, Values, digests, machine, opencl_platform, unfit

if reason := unfit():
    pytest.skip(reason, allow_module_level=True)

HINT = "If this picture was to change, record it anew and name it in the commit: see tests/regression/README.md."


def on_recorded_device() -> bool:
    return opencl_platform().startswith(OPENCL)


@pytest.fixture(scope="module")
def rendered() -> Values:
    """All cases, rendered by one child process."""
    return digests(name for name, case in CASES.items() if not case.device or on_recorded_device())


def test_every_case_is_recorded_and_nothing_else() -> None:
    assert values.read().cases.keys() == {*CASES, "clips"}


def test_clips_are_unchanged(rendered: Values) -> None:
    assert rendered["clips"] == values.read().cases["clips"]


@pytest.mark.parametrize("name", [name for name, case in CASES.items() if not case.device])
def test_frames_have_the_recorded_bytes(name: str, rendered: Values) -> None:
    check(name, rendered)


@pytest.mark.real("opencl")
@pytest.mark.parametrize("name", [name for name, case in CASES.items() if case.device])
def test_frames_on_the_gpu_have_the_recorded_bytes(name: str, rendered: Values) -> None:
    if not on_recorded_device():
        pytest.skip(f"values are recorded for {OPENCL}, this is {opencl_platform()}")
    check(name, rendered)


def check(name: str, rendered: Values) -> None:
    recorded = values.read()
    changed = values.differences(recorded.cases[name], rendered[name])
    assert not changed, f"{changed} differ. {HINT} Recorded for {recorded.machine}; this is {machine()}."
