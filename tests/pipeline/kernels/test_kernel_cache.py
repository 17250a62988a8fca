"""What the cache of compiled kernels uses of Numba's inside: a new version of Numba fails here first, and by name."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numba
from numba.core import caching, dispatcher
from numba.core.runtime import nrt

USED = (
    (caching, ("CompileResultCacheImpl", "FunctionCache", "IndexDataCacheFile", "_CacheLocator")),
    (caching.FunctionCache, ("_impl_class", "_index_key", "_load_overload", "cache_path", "load_overload")),
    (caching.CompileResultCacheImpl, ("_locator_classes",)),
    (caching.IndexDataCacheFile, ("_load_index",)),
    (caching._CacheLocator, ("from_function", "get_cache_path", "get_disambiguator", "get_source_stamp")),
    (dispatcher.Dispatcher, ("_numba_type_", "compile", "stats")),
    (nrt.rtsys, ("initialize",)),
)
PROGRAM = """
import sys
from tests.pipeline.kernels.test_jit import _outer
_outer(3)
print(sum(_outer.compiled.stats.cache_hits.values()), "numba.np.arraymath" in sys.modules)
"""


def test_numba_has_what_the_cache_uses() -> None:
    lacking = [f"{owner}: {name}" for owner, names in USED for name in names if not hasattr(owner, name)]
    assert not lacking, f"Numba {numba.__version__} has changed; pipeline/kernels/kernel_cache.py uses {lacking}"
    compiled = numba.njit(lambda x: x)
    assert hasattr(compiled, "_cache"), f"Numba {numba.__version__}: its dispatchers keep their cache elsewhere"
    assert hasattr(compiled, "targetctx"), f"Numba {numba.__version__}: its dispatchers have no targetctx"


def test_a_second_process_loads_the_code_without_the_compiler(tmp_path: Path) -> None:
    env = {"NUMBA_CACHE_DIR": str(tmp_path), "PATH": "", "HOME": str(tmp_path)}
    root = Path(__file__).parents[3]
    command = [sys.executable, "-c", PROGRAM]
    found = [
        subprocess.run(command, cwd=root, env=env, capture_output=True, text=True, timeout=90).stdout for _ in range(2)
    ]
    assert found == ["0 True\n", "1 False\n"], "the code is not found again, or Numba's compiler is loaded for it"
