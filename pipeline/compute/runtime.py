"""Registration of all OpenCL runtimes of this machine before the first `import pyopencl`.

Drivers and distributions register their runtimes under /etc/OpenCL/vendors, which the OpenCL loader reads. Intel's CPU
runtime from PyPI needs two corrections: its libraries lie in the environment's `lib`, which the dynamic linker does not
search, and its registration file contains a wrong path. This module makes both without any user setting.
"""

from __future__ import annotations

import ctypes
import hashlib
import os
import sys
import tempfile
import threading
import warnings
from functools import cache
from importlib import metadata
from pathlib import Path
from types import ModuleType

import platformdirs

SYSTEM_VENDORS = Path("/etc/OpenCL/vendors")
_INTEL_PACKAGE = "intel-opencl-rt"
_INTEL_RUNTIME = "libintelocl.so"
_INTEL_LIBRARIES = ("libintlc.so.5", "libimf.so", "libsvml.so", "libirng.so")
"""Libraries that the runtime depends on, in loading order."""

_lock = threading.Lock()
_prepared = False


def opencl() -> ModuleType:
    """Import `pyopencl` with all runtimes of this machine registered. Raises ImportError if it is not installed.

    Impasto imports pyopencl only through this function, because the first import fixes the list of runtimes.
    """
    prepare()
    import pyopencl

    # Runtimes emit many build warnings. A failed build raises an error that contains the build log.
    warnings.filterwarnings("ignore", category=pyopencl.CompilerWarning)
    return pyopencl


def prepare() -> None:
    """Register Intel's CPU runtime if it is installed, once per process. A user's OCL_ICD_VENDORS takes precedence."""
    global _prepared
    with _lock:
        if not _prepared and "pyopencl" not in sys.modules and "OCL_ICD_VENDORS" not in os.environ:
            register(intel_runtime())
        _prepared = True


def intel_runtime() -> Path | None:
    """Path of Intel's CPU runtime library; None if its package is not installed in this environment."""
    try:
        files = metadata.files(_INTEL_PACKAGE) or []
    except metadata.PackageNotFoundError:
        return None
    found = (Path(str(f.locate())).resolve() for f in files if f.name == _INTEL_RUNTIME)
    return next((path for path in found if path.exists()), None)


def registrations() -> dict[str, str]:
    """Registrations that the loader reads: name of the registration file -> path or name of its library."""
    folder = Path(os.environ.get("OCL_ICD_VENDORS", SYSTEM_VENDORS))
    if not folder.is_dir():  # the variable may also name a single file or library
        return {folder.name: str(folder)}
    return {f.name: f.read_text(errors="replace").strip() for f in sorted(folder.glob("*.icd"))}


def register(runtime: Path | None) -> None:
    """Make an OpenCL runtime visible to this process and its children, by the loader's environment variable.

    Args:
        runtime: the runtime's library. If it is None or cannot be loaded here, nothing changes.
    """
    if runtime is None or not _load_libraries(runtime.parent):
        return
    wanted = {**registrations(), "impasto-intel-cpu.icd": str(runtime)}
    # The loader can be configured only through this variable, which it reads when pyopencl is imported. This is the
    # only place where Impasto writes to the environment. Child processes inherit it and see the same runtimes.
    os.environ["OCL_ICD_VENDORS"] = str(_vendors(wanted))


def _load_libraries(folder: Path) -> bool:
    """Load the libraries that the runtime depends on, so that the linker finds them; False if one cannot be loaded."""
    try:
        for name in _INTEL_LIBRARIES:
            ctypes.CDLL(str(folder / name), mode=ctypes.RTLD_GLOBAL)
    except OSError:
        return False  # another architecture or an incomplete installation: do not register the runtime
    return True


def _vendors(wanted: dict[str, str]) -> Path:
    """A folder with these registration files, named by their hash: created once, immutable, shared by processes."""
    name = hashlib.sha256(repr(sorted(wanted.items())).encode()).hexdigest()[:16]
    target = cache_folder() / "opencl-vendors" / name
    if target.is_dir():
        return target
    fresh = Path(tempfile.mkdtemp(dir=_made(target.parent)))
    for file, library in wanted.items():
        (fresh / file).write_text(library + "\n")
    try:
        fresh.rename(target)
    except OSError:  # another process was faster
        return target if target.is_dir() else fresh
    return target


@cache
def cache_folder() -> Path:
    """Folder of cached test results and registrations; a temporary one if the user's cache folder is not writable."""
    try:
        return _made(Path(platformdirs.user_cache_dir("impasto", appauthor=False)))
    except OSError:
        return Path(tempfile.mkdtemp(prefix="impasto-"))


def _made(folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    if not os.access(folder, os.W_OK):
        raise PermissionError(f"{folder} cannot be written")
    return folder
