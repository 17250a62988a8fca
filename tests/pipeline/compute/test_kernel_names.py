"""No kernel or function has the name of a built-in function of OpenCL C: some runtimes rename those by macros."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import pipeline

FILES = sorted(Path(pipeline.__file__).parent.rglob("*.cl"))
FUNCTION = re.compile(r"^(?:kernel|static)\s+\w+\s+\*?(\w+)\(", re.MULTILINE)
# OpenCL C 1.2 specification, sections 6.12.1 to 6.12.13, without names that begin with a prefix of PREFIXES.
BUILT_IN = """
    acos acosh acospi asin asinh asinpi atan atan2 atanh atanpi atan2pi cbrt ceil copysign cos cosh cospi erfc
    erf exp exp2 exp10 expm1 fabs fdim floor fma fmax fmin fmod fract frexp hypot ilogb ldexp lgamma lgamma_r
    log log2 log10 log1p logb mad maxmag minmag modf nan nextafter pow pown powr remainder remquo rint rootn
    round rsqrt sin sincos sinh sinpi sqrt tan tanh tanpi tgamma trunc abs abs_diff add_sat hadd rhadd clamp
    clz mad_hi mad_sat max min mul_hi rotate sub_sat upsample popcount mad24 mul24 degrees mix radians step
    smoothstep sign cross dot distance length normalize fast_distance fast_length fast_normalize isequal
    isnotequal isgreater isgreaterequal isless islessequal islessgreater isfinite isinf isnan isnormal
    isordered isunordered signbit any all bitselect select barrier mem_fence read_mem_fence write_mem_fence
    prefetch wait_group_events shuffle shuffle2 printf
"""
PREFIXES = """
    as_ async_ atom_ atomic_ convert_ get_ half_ native_ read_ vload vstore work_ write_
"""


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_no_function_has_the_name_of_a_built_in_function(file: Path) -> None:
    names = FUNCTION.findall(file.read_text())
    assert names, "the expression finds no function"
    assert not [name for name in names if name in BUILT_IN.split() or name.startswith(tuple(PREFIXES.split()))]
