"""`make demo`: draws a clip, starts the service, and paints the clip through the API.

The demo ships and downloads no media: the clip is the procedural scene "harbour". The results are in demo-output/: the
clip, the cartoon, a contact sheet and a poster.
"""

from __future__ import annotations

import contextlib
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from impasto import Client
from impasto.cli.app import run as command
from impasto.cli.console import progress

OUTPUT = Path(__file__).resolve().parent.parent / "demo-output"
FRAMES, SIZE = 72, "480x270"


def main() -> None:
    OUTPUT.mkdir(exist_ok=True)
    clip = OUTPUT / "harbour.mp4"
    print(f"Drawing the scene harbour: {FRAMES} frames of {SIZE}")
    if command(
        ["scene", "harbour", "-o", str(clip), "--frames", str(FRAMES), "--size", SIZE, "--quiet", "--overwrite"]
    ):
        sys.exit(1)
    with tempfile.TemporaryDirectory(prefix="impasto-demo-") as home, service(Path(home)) as impasto:
        paint(impasto, clip)
    print("\nThe picture is in")
    for name in ("cartoon.mp4", "contact-sheet.jpg", "poster.jpg", "harbour.mp4"):
        print(f"  {OUTPUT / name}")
    print(
        "\nTry your own:  .venv/bin/impasto serve  (a web page), or  .venv/bin/impasto render clip.mp4 -o cartoon.mp4"
    )


def paint(impasto: Client, clip: Path) -> None:
    """Run one job, as any client would."""
    video = impasto.upload(clip)
    job = impasto.submit("abstraction", {"video": video["id"]}, name="demo")
    print(f"Painting it: job {job['id']} at {impasto.server}")
    with progress() as show:
        for now in impasto.watch(job["id"]):
            show(now)
    impasto.wait(job["id"])
    for name, file in (("result", "cartoon.mp4"), ("sheet", "contact-sheet.jpg"), ("poster", "poster.jpg")):
        impasto.download(job["id"], OUTPUT / file, name)


@contextlib.contextmanager
def service(home: Path) -> Iterator[Client]:
    """Start the service in a separate process on a free port; yields a client of it."""
    log = home / "service.log"
    with log.open("wb") as sink:
        process = subprocess.Popen(  # noqa: S603  (our own command, no shell, no foreign word in it)
            [sys.executable, "-m", "impasto", "serve", "--port", "0", "--home", str(home / "data")],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=sink,
            text=True,
        )
    try:
        assert process.stdout is not None
        address = process.stdout.readline().strip()  # printed once it answers; nothing if it could not start
        if not address:
            sys.exit(f"The service did not start. Its log:\n{log.read_text(errors='replace')[-4000:]}")
        with Client(address) as impasto:
            yield impasto
    finally:
        process.terminate()
        process.wait(timeout=30)


if __name__ == "__main__":
    main()
