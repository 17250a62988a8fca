"""kill -9 of the whole process tree at ten random moments of a job. The job must finish with the same bytes as an
undisturbed run.

The job runs in three ways: with `impasto render`; with `impasto serve` and a client that waits; and the latter with the
farm on Ray. After each kill the command is started again with the same home and address. tests/e2e/test_kill.py is the
short form.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path

from benchmarks.loops import looped, source
from impasto.cli.app import run
from tests.e2e.killing import RENDER, Killed, kill_points, render_killed, serve_killed

CLIP, SIZE = "bikes_scene_cuts.mp4", "640x272"
FRAMES = 750
"""Half a minute of video with several shots, about ten tasks."""
DEATHS, THEN_S = 10, 0.4
"""Number of kills, and the maximum delay of a kill after its share of the frames is painted, seconds."""
WAYS: dict[str, Callable[..., list[Killed]]] = {
    "render": render_killed,
    "serve --farm local": partial(serve_killed, farm="local"),
    "serve --farm ray": partial(serve_killed, farm="ray"),
}


def main() -> None:
    """Print every kill, and whether the final bytes are equal."""
    with tempfile.TemporaryDirectory(prefix="impasto-kill9-") as scratch:
        folder = Path(scratch)
        clip = looped(source(CLIP, SIZE, folder), FRAMES, folder / "clip.mp4")
        whole, calm_s = undisturbed(clip, folder)
        print(f"{FRAMES} frames, {len(whole)} bytes, undisturbed in {calm_s:.1f} s")
        same = [survives(name, clip, whole, folder / f"way-{seed}", seed) for seed, name in enumerate(WAYS, start=1)]
    if not all(same):
        raise SystemExit("The bytes differ.")


def undisturbed(clip: Path, folder: Path) -> tuple[bytes, float]:
    """The result of the undisturbed job, and its duration in seconds."""
    began = time.monotonic()
    if run(["render", str(clip), "-o", str(folder / "calm.mp4"), "--home", str(folder / "calm"), *RENDER]):
        raise SystemExit("The undisturbed render failed.")
    return (folder / "calm.mp4").read_bytes(), time.monotonic() - began


def survives(name: str, clip: Path, whole: bytes, home: Path, seed: int) -> bool:
    """Run the job in one way and kill it ten times; print the kills; whether the result equals `whole`."""
    out = home.with_suffix(".mp4")
    began = time.monotonic()
    deaths = WAYS[name](clip, out, home, plan=kill_points(DEATHS, 0.97 * FRAMES, THEN_S, seed))
    same = out.read_bytes() == whole
    print(f"\n{name}: killed {len(deaths)} times, {time.monotonic() - began:.0f} s in all, bytes equal: {same}")
    show(deaths)
    return same


def show(deaths: Iterable[Killed]) -> None:
    print(f"{'death':>6} {'lived s':>8} {'processes':>10} {'frames painted':>15} {'in finished tasks':>18}")
    for number, death in enumerate(deaths, start=1):
        print(f"{number:6} {death.lived_s:8.1f} {death.processes:10} {death.frames:15.0f} {death.finished:18}")
