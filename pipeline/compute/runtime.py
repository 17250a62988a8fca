"""Make every OpenCL runtime on this machine visible, before the first `import pyopencl`.

Drivers and distributions register their runtimes under /etc/OpenCL/vendors, which OpenCL's loader reads. Intel's CPU
runtime from PyPI does not work so: its libraries lie in the environment's `lib`, where the dynamic linker does not
look, and the registration that it ships holds a broken path. Both are put right here, without any setting by the user.
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
_INTEL_NEEDS = ("libintlc.so.5", "libimf.so", "libsvml.so", "libirng.so")
"""In the order in which they need each other."""

_lock = threading.Lock()
_prepared = False


def opencl() -> ModuleType:
    """The module `pyopencl`, with every runtime of this machine listed. ImportError where it is not installed.

    The only way in which Impasto imports it: whoever imports it before has fixed the list of runtimes.
    """
    prepare()
    import pyopencl

    # Runtimes are talkative; what a failed build says is in the error that it raises.
    warnings.filterwarnings("ignore", category=pyopencl.CompilerWarning)
    return pyopencl


def prepare() -> None:
    """Register Intel's CPU runtime where it is installed. Once a process; what the user has set wins."""
    global _prepared
    with _lock:
        if not _prepared and "pyopencl" not in sys.modules and "OCL_ICD_VENDORS" not in os.environ:
            _register(intel_runtime())
        _prepared = True


def intel_runtime() -> Path | None:
    """Where Intel's CPU runtime lies, if its package is installed in this environment."""
    try:
        files = metadata.files(_INTEL_PACKAGE) or []
    except metadata.PackageNotFoundError:
        return None
    found = (Path(str(f.locate())).resolve() for f in files if f.name == _INTEL_RUNTIME)
    return next((path for path in found if path.exists()), None)


def registrations() -> dict[str, str]:
    """What the loader will read: the name of each registration file -> the library it names."""
    folder = Path(os.environ.get("OCL_ICD_VENDORS", SYSTEM_VENDORS))
    if not folder.is_dir():  # the loader also takes one file or one library here
        return {folder.name: str(folder)}
    return {f.name: f.read_text(errors="replace").strip() for f in sorted(folder.glob("*.icd"))}


def _register(runtime: Path | None) -> None:
    if runtime is None or not _load_needs(runtime.parent):
        return
    wanted = {**registrations(), "impasto-intel-cpu.icd": str(runtime)}
    # The loader has no other door than this variable, and reads it when pyopencl is imported: hence the one write to
    # the environment in Impasto. Child processes inherit it, which is right: they see the same runtimes.
    os.environ["OCL_ICD_VENDORS"] = str(_vendors(wanted))


def _load_needs(folder: Path) -> bool:
    """Load what the runtime needs, so that the linker finds it already there."""
    try:
        for name in _INTEL_NEEDS:
            ctypes.CDLL(str(folder / name), mode=ctypes.RTLD_GLOBAL)
    except OSError:
        return False  # not this machine's architecture, or half installed: then it is not offered
    return True


def _vendors(wanted: dict[str, str]) -> Path:
    """A folder with these registrations, named by its content: made once, never changed, shared by processes."""
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
    """Where verdicts and registrations are kept; a temporary folder where the user's own cannot be written."""
    try:
        return _made(Path(platformdirs.user_cache_dir("impasto", appauthor=False)))
    except OSError:
        return Path(tempfile.mkdtemp(prefix="impasto-"))


def _made(folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    if not os.access(folder, os.W_OK):
        raise PermissionError(f"{folder} cannot be written")
    return folder
