"""`impasto render` reads thumbnails while it imports its modules: those of the right file."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

from impasto.cli import early
from tests.conftest import ROOT


@pytest.fixture(autouse=True)
def nothing_begun() -> Iterator[None]:
    early._begun = None
    yield
    if early._begun is not None:
        early._begun.close()
    early._begun = None


@pytest.mark.parametrize(
    "arguments",
    [
        ("VIDEO", "-o", "OUT"), ("-o", "OUT", "VIDEO"), ("--output", "OUT", "--overwrite", "VIDEO", "--quiet"),
        ("-m", "abstraction", "--input", "OUT", "VIDEO"),
    ],
)  # fmt: skip
def test_the_video_is_found_among_the_arguments(tiny_clip: Path, tmp_path: Path, arguments: Sequence[str]) -> None:
    (out := tmp_path / "out.mp4").write_bytes(b"an earlier result")
    early.begin([{"VIDEO": str(tiny_clip), "OUT": str(out)}.get(text, text) for text in arguments])
    assert early.thumbnails_of(tiny_clip) is not None
    assert early.thumbnails_of(out) is None


@pytest.mark.parametrize("arguments", [("VIDEO", "--estimate"), ("-", "-o", "-"), ("none.mp4",), ()])
def test_nothing_is_read_without_a_render_of_a_file(tiny_clip: Path, arguments: Sequence[str]) -> None:
    early.begin([str(tiny_clip) if text == "VIDEO" else text for text in arguments])
    assert early.thumbnails_of(tiny_clip) is None


TOLD = """
import sys
from workers.execution.decoders import Decoders
take = Decoders._take_ahead
def taken(self, key):
    found = take(self, key)
    print("ahead" if found is not None else "not ahead", file=sys.stderr)
    return found
Decoders._take_ahead = taken
from impasto.__main__ import main
main()
"""


@pytest.mark.parametrize(("options", "told"), [((), ["ahead"]), (("--frames", "2:8"), [])])
def test_a_render_uses_them_for_whole_videos(
    tiny_clip: Path, tmp_path: Path, options: Sequence[str], told: list[str]
) -> None:
    command = [sys.executable, "-c", TOLD, "render", str(tiny_clip), "-o", str(tmp_path / "out.mp4"), "--quiet"]
    done = subprocess.run(
        [*command, *options, "--home", str(tmp_path / "home")], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert [line for line in done.stderr.splitlines() if "ahead" in line] == told


def test_the_decoder_server_starts_before_large_imports() -> None:
    large = "{'numpy', 'typer', 'pydantic'} & set(sys.modules)"
    imported = f"import sys, impasto.__main__, impasto.cli.early; print(*{large})"
    done = subprocess.run([sys.executable, "-c", imported], cwd=ROOT, capture_output=True, text=True, check=True)
    assert not done.stdout.strip()
