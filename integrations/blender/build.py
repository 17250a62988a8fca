# SPDX-License-Identifier: GPL-3.0-or-later
"""Builds the extension with the client's wheels in it: python integrations/blender/build.py OUT.zip

All wheels are pure Python, so that one file serves every system.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
SOURCE = HERE / "impasto_blender"
EPOCH = (1980, 1, 1, 0, 0, 0)


def build(target: Path) -> Path:
    """Write the extension. Raises: CalledProcessError of pip, RuntimeError if a wheel is not pure Python."""
    with tempfile.TemporaryDirectory() as scratch:
        wheels = _wheels(Path(scratch))
        files = {path.name: path.read_bytes() for path in sorted(SOURCE.glob("*.py"))}
        listed = ", ".join(f'"./wheels/{wheel.name}"' for wheel in wheels)
        manifest = (SOURCE / "blender_manifest.toml").read_text().replace("wheels = []", f"wheels = [{listed}]")
        files["blender_manifest.toml"] = manifest.encode()
        files |= {f"wheels/{wheel.name}": wheel.read_bytes() for wheel in wheels}
        with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, data in files.items():
                entry = zipfile.ZipInfo(name, EPOCH)
                entry.compress_type, entry.external_attr = zipfile.ZIP_DEFLATED, 0o644 << 16
                archive.writestr(entry, data)
    return target


def _wheels(folder: Path) -> list[Path]:
    """The client and what it requires."""
    pip = [sys.executable, "-m", "pip", "wheel", "-q", "-w", str(folder), "-c", str(ROOT / "constraints.txt")]
    subprocess.run([*pip, str(ROOT / "client")], check=True)
    wheels = sorted(folder.glob("*.whl"))
    if mixed := [wheel.name for wheel in wheels if not wheel.name.endswith("-none-any.whl")]:
        raise RuntimeError(f"Not pure Python: {', '.join(mixed)}.")
    return wheels


if __name__ == "__main__":
    print(build(Path(sys.argv[1])))
