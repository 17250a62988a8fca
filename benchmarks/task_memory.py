"""Peak memory of the tasks of each step, and the memory that the method requests for them.

    python -m benchmarks.task_memory METHOD FRAMES WIDTH ...      peaks at these widths (16:9), MiB
    python -m benchmarks.task_memory --deep METHOD ...            of 10-bit video painted to floating point

A worker in this process runs a job's tasks one after the other. The peak of a task is the kernel's VmHWM, reset before
the task begins, plus the memory of its decoders.
"""

from __future__ import annotations

import multiprocessing
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import psutil

from benchmarks.loops import source
from benchmarks.speedup import METHODS, style_of

CLIP, SIZE = "dog_720p_audio.mp4", "1280x720"
FRAMES = {"abstraction": 60, "patches": 24, "analogy": 4, "multistyle": 36}
WIDTHS = (640, 1280)
MIB = 1 << 20


def main() -> None:
    """Print the largest task peak of each step, and the requested memory."""
    words = sys.argv[1:] if __name__ == "__main__" else []
    deep = words[:1] == ["--deep"]
    words = words[deep:]
    names = words[:1] or METHODS
    widths = tuple(map(int, words[2:])) or WIDTHS
    spawn = multiprocessing.get_context("spawn")
    print(f"{'method':>12} {'step':>12} {'size':>10} {'frames':>7} {'peak MiB':>9} {'asked MiB':>10}")
    for name in names:
        frames = int(words[1]) if len(words) > 1 else FRAMES[name]
        for width in widths:
            with tempfile.TemporaryDirectory(prefix="impasto-needs-") as folder, spawn.Pool(1) as one:
                for step, (peak, asked) in one.apply(measure, (name, Path(folder), frames, width, deep)).items():
                    size = f"{width}x{width * 9 // 16}"
                    print(f"{name:>12} {step:>12} {size:>10} {frames:7} {peak:9.0f} {asked:10.0f}", flush=True)


def measure(name: str, folder: Path, frames: int, width: int, deep: bool) -> dict[str, Sequence[float]]:
    """Step -> (largest peak of its tasks, memory that they request), MiB."""
    from pipeline.methods import method
    from workers.contract.request import JobRequest, OutputSpec
    from workers.execution.renderer import Renderer
    from workers.farm import Farm
    from workers.scheduling.in_turn import run_in_turn
    from workers.settings import FarmSettings

    farm = Farm(FarmSettings(home=folder, pool="none", reserve_bytes=0), None)
    clip = _clip(folder, frames, width, deep)
    inputs = {"video": farm.assets.add(clip, clip.name).id}
    if style := style_of(name):
        inputs["style_output"] = farm.assets.add(style, style.name).id
    needed = [spec.name for spec in method(name).inputs if spec.required and spec.kind.endswith("video")]
    inputs |= dict.fromkeys(needed, inputs["video"])
    farm.jobs.submit(JobRequest(name, inputs, output=OutputSpec("exr" if deep else "mp4")))
    found: dict[str, list[float]] = {}
    with Renderer(farm.blobs, folder / "scratch") as renderer:
        _reset_peak()
        for run in run_in_turn(farm.store, renderer):
            order, outcome = run.order, run.outcome
            if outcome.fault is not None:
                raise SystemExit(f"{order.step}/{order.key}: {outcome.fault}")
            peak, asked = found.setdefault(order.step, [0.0, 0.0])
            wants = 0 if order.resources is None else order.resources.memory_bytes
            found[order.step] = [max(peak, _peak() / MIB), max(asked, wants / MIB)]
            _reset_peak()
    farm.stop()
    return {step: tuple(both) for step, both in found.items()}


def _reset_peak() -> None:
    Path("/proc/self/clear_refs").write_text("5")


def _peak() -> int:
    """Peak of this process since the last reset plus the current memory of its children, bytes."""
    own = next(line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmHWM"))
    children = psutil.Process().children(recursive=True)
    return int(own.split()[1]) * 1024 + sum(child.memory_full_info().pss for child in children)


def _clip(folder: Path, frames: int, width: int, deep: bool) -> Path:
    """The first frames of a real clip at this width; `deep`: with 10 bits, losslessly."""
    import av

    path = folder / f"clip-{width}.{'mkv' if deep else 'mp4'}"
    codec, pixels = ("ffv1", "yuv420p10le") if deep else ("libx264", "yuv420p")
    with av.open(str(source(CLIP, SIZE, folder))) as given, av.open(str(path), "w") as out:
        stream = out.add_stream(codec, rate=given.streams.video[0].average_rate)
        assert isinstance(stream, av.VideoStream)
        stream.width, stream.height, stream.pix_fmt = width, width * 9 // 16, pixels
        for number, frame in enumerate(given.decode(video=0)):
            if number == frames:
                break
            out.mux(stream.encode(frame.reformat(stream.width, stream.height, pixels)))
        out.mux(stream.encode(None))
    return path


if __name__ == "__main__":
    main()
