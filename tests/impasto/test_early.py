"""`impasto render` starts the decoder server before its large imports."""

from __future__ import annotations

import subprocess
import sys

from tests.conftest import ROOT


def test_the_decoder_server_starts_before_large_imports() -> None:
    large = "{'numpy', 'typer', 'pydantic'} & set(sys.modules)"
    imported = f"import sys, impasto.__main__, pipeline.video.guard.decoder_server; print(*{large})"
    done = subprocess.run([sys.executable, "-c", imported], cwd=ROOT, capture_output=True, text=True, check=True)
    assert not done.stdout.strip()
