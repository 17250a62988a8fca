"""`impasto render --explain`: prints the plan of a render, and its expected times."""

from __future__ import annotations

import dataclasses
import tempfile
from pathlib import Path

from impasto.cli import private_farm
from impasto.cli.estimating import estimate_render
from impasto.cli.rendering import RenderOrder, gathered
from impasto_client.errors import JobFailed
from pipeline.errors import BadInput
from workers.contract.request import Json
from workers.execution.renderer import Renderer
from workers.farm import Farm
from workers.jobs.frame_window import window_inputs
from workers.scheduling.explanation import Explanation, TaskKind, explained
from workers.scheduling.in_turn import run_in_turn
from workers.settings import FarmSettings


def explain_render(order: RenderOrder, home: Path) -> tuple[Explanation, int]:
    """The plan of a render, and the number of earlier renders from which its processor time is estimated. The first
    step is run, since everything depends on the shots.

    Raises: BadInput (an input cannot be used, or nothing is known of the video), BadParameter, JobFailed.
    """
    with tempfile.TemporaryDirectory(prefix="impasto-explain-") as folder:
        files = gathered(order, Path(folder))
        settings = FarmSettings(home=Path(folder) / "farm", pool="none", reserve_bytes=0)
        farm = Farm(settings, None, private=True)
        try:
            job = private_farm.submit(farm, order.request, files, "explain")
            with Renderer(farm.blobs, settings.scratch, overview=False) as renderer:
                for run in run_in_turn(farm.store, renderer):
                    if run.outcome.fault is not None:
                        fault = run.outcome.fault
                        raise JobFailed(fault.message, field=fault.field, value=fault.value, remedy=fault.remedy)
                    if farm.jobs.get(job.id).steps[0].state == "succeeded":
                        break
            found, _ = farm.store.task_inputs.before(job.id, 1)
            request = dataclasses.replace(job.request, inputs=dict.fromkeys(files, ""))
            info = farm.store.task_inputs.input_info(job.request.inputs)
        finally:
            farm.stop()
        info = window_inputs(info, request.frames, request.source)
        estimate = estimate_render(order.request, files["video"].path, home)
    if estimate["cpu_s"] is None:
        raise BadInput("Nothing is known of this video: it names neither its frames nor their size.", field="IN")
    return explained(request, info, found, estimate["cpu_s"]), estimate["samples"]


def as_json(explanation: Explanation, samples: int) -> Json:
    """The explanation as `--json` prints it."""
    return {**explanation.as_json(), "samples": samples}


def as_text(explanation: Explanation, samples: int) -> str:
    """The explanation for people."""
    basis = f"{samples} earlier renders" if samples else "the method's own figures"
    lines = [f"{explanation.frames} frames, {explanation.cpu_s:.1f} s of processor time, from {basis}.", "", "Plan:"]
    lines += [_line(kind) for kind in explanation.kinds]
    if any(kind.expected for kind in explanation.kinds):
        lines.append("  * planned from typical results of the steps before")
    lines += ["", f"Critical path, {explanation.path_s:.1f} s:", *map(_line, explanation.path), ""]
    lines.append("Processors  seconds  speed-up")
    for each in explanation.durations:
        lines.append(f"{each.processors:>10} {each.seconds:>8.1f} {each.speedup:>9.1f}")
    return "\n".join(lines)


def _line(kind: TaskKind) -> str:
    count = f"{kind.tasks} task{'s' if kind.tasks > 1 else ''}"
    return f"  {kind.title + ('*' if kind.expected else ''):<24} {kind.kind:<24} {count:>10} {kind.cpu_s:>9.2f} s"
