"""`impasto doctor`: checks whether this machine can render, and names remedies. `impasto version`.

Each check examines the real part and never raises.
"""

from __future__ import annotations

import platform
import shutil
import sys
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError
from importlib.metadata import version as installed_version
from pathlib import Path
from typing import Annotated, Literal

import typer

from impasto.cli.console import FAILED, emit, out
from impasto.cli.options import HomeOption, JsonFlag, home_of
from workers.contract.request import Json
from workers.process.starting import readable_by_others
from workers.version import version as impasto_version

MARKS = {"ok": "[green]ok  [/green]", "warning": "[yellow]warn[/yellow]", "broken": "[red]BAD [/red]"}


def doctor(
    home: HomeOption = None,
    device: Annotated[str, typer.Option(help="An OpenCL device to check: gpu, cpu, or part of a name.")] = "",
    as_json: JsonFlag = False,
) -> None:
    """Check Python, packages, OpenCL devices, codecs, disk and memory.

    Exit status 1 when something that rendering needs is broken.
    """
    found = checks(home_of(home), device)
    broken = [check for check in found if check.state == "broken"]
    if as_json:
        emit({"ok": not broken, "checks": [check.as_json() for check in found]})
    else:
        for check in found:
            out.print(f"{MARKS[check.state]} [bold]{check.name}[/bold]", end="  ")
            out.print(check.detail, markup=False)
            if check.remedy and check.state != "ok":
                out.print(f"       {check.remedy}", markup=False)
    if broken:
        raise typer.Exit(FAILED)


def version(as_json: JsonFlag = False) -> None:
    """Print the version of Impasto."""
    if as_json:
        emit({"version": impasto_version(), "python": platform.python_version()})
    else:
        out.print(f"impasto {impasto_version()}")


def print_version(asked: bool) -> None:
    """Callback of `impasto --version`."""
    if asked:
        version()
        raise typer.Exit


State = Literal["ok", "warning", "broken"]
GIB = 1 << 30

PACKAGES = ("numpy", "opencv-contrib-python-headless", "numba", "av", "pyopencl", "pydantic", "sqlalchemy", "fastapi")
OPTIONAL = (("ray", "only `--farm ray` needs it"), ("boto3", "only blobs on S3 need it"))
CODECS = (
    ("h264", "r", True),
    ("libx264", "w", True),
    ("aac", "w", True),
    ("png", "r", True),
    ("vp9", "r", False),
    ("libvpx-vp9", "w", False),
    ("libopus", "w", False),
    ("hevc", "r", False),
    ("av1", "r", False),
)
"""FFmpeg's name, reading or writing, and whether rendering is broken without it."""


@dataclass(frozen=True)
class Check:
    """Result of a check: state of the part, and remedy."""

    name: str
    state: State
    detail: str
    remedy: str = ""

    def as_json(self) -> Json:
        return asdict(self)


def checks(home: Path, device: str = "") -> list[Check]:
    """All checks, in the order of output."""
    return [
        _python(),
        *_packages(),
        *_opencl(device),
        *_codecs(),
        _cascade(),
        _methods(),
        _disk(home),
        *_privacy(home),
        _memory(),
    ]


def _python() -> Check:
    facts = f"{sys.version.split()[0]} at {sys.executable}"
    fits = sys.version_info >= (3, 11)
    return Check("python", "ok" if fits else "broken", facts, "Impasto needs Python 3.11 or newer.")


def _packages() -> Iterator[Check]:
    for name in PACKAGES:
        found = _version(name)
        yield Check(name, "ok" if found else "broken", found or "not installed", f"pip install {name}")
    for name, require_extra in OPTIONAL:
        found = _version(name)
        yield Check(
            name, "ok" if found else "warning", found or f"not installed; {require_extra}", f"pip install {name}"
        )


def _version(name: str) -> str:
    try:
        return installed_version(name)
    except PackageNotFoundError:
        return ""


def _opencl(wanted: str) -> Iterator[Check]:
    """One row per device, with the reason why it was chosen or not. Without a working device the result is a warning,
    because some methods need one."""
    from pipeline.compute import report

    rows = report(wanted)
    for row in rows:
        name = " ".join(str(row[part]) for part in ("platform", "device", "version") if row[part])
        state: State = "ok" if row["works"] else "warning"
        yield Check("opencl", state, f"{'CHOSEN: ' if row['chosen'] else ''}{name}: {row['reason']}")
    if not any(row["chosen"] for row in rows):
        yield Check("opencl", "broken" if wanted else "warning", "no device is chosen", "pip install 'impasto[cpu]'")


def _codecs() -> Iterator[Check]:
    import av

    yield Check("ffmpeg", "ok", ", ".join(f"{k} {_dotted(v)}" for k, v in sorted(av.library_versions.items())))
    for name, mode, needed in CODECS:
        verb = "reads" if mode == "r" else "writes"
        try:
            av.Codec(name, mode)  # type: ignore[arg-type]
            yield Check(f"codec {name}", "ok", verb)
        except ValueError:
            state: State = "broken" if needed else "warning"
            yield Check(f"codec {name}", state, f"PyAV's FFmpeg does not: {verb}", "pip install --force-reinstall av")


def _dotted(parts: tuple[int, ...]) -> str:
    return ".".join(str(part) for part in parts)


def _cascade() -> Check:
    import cv2

    remedy = "pip install 'opencv-contrib-python-headless<5': later ones ship without it."
    folder = getattr(getattr(cv2, "data", None), "haarcascades", "")
    file = Path(folder) / "haarcascade_frontalface_default.xml"
    if not folder or cv2.CascadeClassifier(str(file)).empty():
        return Check("face cascade", "broken", f"OpenCV cannot load {file}", remedy)
    return Check("face cascade", "ok", str(file))


def _methods() -> Check:
    try:
        from pipeline.methods import methods

        return Check("methods", "ok", ", ".join(methods()))
    except Exception as error:  # an outside package may fail in any way
        return Check(
            "methods", "broken", f"{type(error).__name__}: {error}", "Repair or remove the package that it names."
        )


def _disk(home: Path) -> Check:
    there = next(folder for folder in (home, *home.parents) if folder.exists())
    free = shutil.disk_usage(there).free / GIB
    state: State = "broken" if free < 0.5 else "warning" if free < 5 else "ok"
    return Check("disk", state, f"{free:.1f} GiB free for {home}", "Free some, or name another folder with --home.")


def _privacy(home: Path) -> Iterator[Check]:
    """Whether other users of this machine can read the home: its database has private data."""
    if home.is_dir():
        mode = readable_by_others(home)
        detail = f"other users of this machine can enter {home} (mode {mode})" if mode else f"{home} is private"
        yield Check("home", "warning" if mode else "ok", detail, f"chmod 700 {home}")


def _memory() -> Check:
    import psutil

    memory = psutil.virtual_memory()
    state: State = "warning" if memory.available < GIB else "ok"
    facts = f"{memory.available / GIB:.1f} of {memory.total / GIB:.1f} GiB available, {psutil.cpu_count()} cores"
    return Check("memory", state, facts, "Close something, or render with --workers 1.")
