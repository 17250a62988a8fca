"""What `impasto render` does once its words are understood: gather, run, deliver, say what it cost."""

from __future__ import annotations

import dataclasses
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from impasto import __version__
from impasto.cli import embedded
from impasto.cli.delivery import Target, beside, deliver
from impasto.cli.materials import Material, gather
from impasto.cli.place import forget, key_of, place, sweep
from impasto.cli.progress import Show
from impasto.cli.timing import Timing, rounded
from pipeline.errors import BadInput
from pipeline.methods import method, parse_params
from pipeline.methods.base import Method
from pipeline.video.probe import probe
from workers.farm import Farm
from workers.model import Job, JobRequest, Json
from workers.warmup import warm_up


@dataclass(frozen=True)
class Commission:
    """A render as ordered: the request without asset ids, the paths of its inputs, and where all goes."""

    request: JobRequest
    paths: Mapping[str, Path]
    where: Target
    artefacts: Mapping[str, Path | None]
    """Artefact -> where it goes, None: beside the result."""

    def check(self) -> None:
        """Refuse what is plainly wrong before a byte is read. Raises: BadParameter, BadInput."""
        chosen = method(self.request.method)
        parse_params(chosen, self.request.params)
        _check_inputs(chosen, self.paths)
        for name in self.artefacts:
            if name not in chosen.artefacts:
                raise BadInput(
                    f"The method {chosen.name!r} makes no artefact {name!r}.",
                    field="--artefact",
                    value=name,
                    remedy=f"It can make: {', '.join(chosen.artefacts) or 'none'}.",
                )


def _check_inputs(chosen: Method, paths: Mapping[str, Path]) -> None:
    known = {spec.name: spec for spec in chosen.inputs}
    for name in paths:
        if name not in known:
            raise BadInput(
                f"The method {chosen.name!r} takes no input {name!r}.",
                field="--input",
                value=name,
                remedy=f"It takes: {', '.join(known)}.",
            )
    for name, spec in known.items():
        if spec.required and name not in paths:
            raise BadInput(
                f"The method {chosen.name!r} needs the input {name!r}: {spec.help}",
                field="--input",
                remedy=f"Add --input {name}=PATH.",
            )


def run(order: Commission, workers: int, home: Path, show: Show) -> Json:
    """Render, in a folder of this command's own, and return the summary that `--json` prints.

    Raises: BadInput (what is wrong with an input), Interrupted, JobFailed, Conflict (the same render is at work).
    """
    began = time.monotonic()
    sweep(home)
    with tempfile.TemporaryDirectory(prefix="impasto-") as scratch:
        materials = _gather(order.paths, Path(scratch))
        key = key_of(_facts(order, materials))
        _warm_up(order.request)
        with place(home, key) as folder:
            with embedded.opened(folder, workers) as farm:
                job = embedded.follow(farm, embedded.submit(farm, order.request, materials, key).id, show)
                summary = _deliver(farm, job, order)
            forget(folder)
    return summary | {"wall_seconds": round(time.monotonic() - began, 4)}


def _warm_up(request: JobRequest) -> None:
    chosen = method(request.method)
    warm_up(chosen, parse_params(chosen, request.params))


def _gather(paths: Mapping[str, Path], scratch: Path) -> dict[str, Material]:
    return {name: gather("IN" if name == "video" else f"--input {name}", path, scratch) for name, path in paths.items()}


def _facts(order: Commission, materials: Mapping[str, Material]) -> Json:
    """What makes two commands the same one. The number of workers does not: it may change between two tries."""
    return {
        "version": __version__,
        "request": dataclasses.asdict(order.request),
        "inputs": {name: material.sha256 for name, material in materials.items()},
        "output": order.where.path,
    }


def _deliver(farm: Farm, job: Job, order: Commission) -> Json:
    """Put artefacts and the result in their places, the result last: where it is, all is."""
    artefacts = _deliver_artefacts(farm, job, order)
    with farm.local(farm.file(job.id, "result")) as file:
        info = probe(file)
        deliver(file, order.where)
    timing = Timing.of(job, embedded.tasks(farm, job.id))
    return {
        "frames": info.frames,
        "width": info.width,
        "height": info.height,
        "seconds": round(timing.seconds, 4),
        "fps": round(info.frames / timing.seconds, 3) if timing.seconds else 0.0,
        "steps": rounded(timing.steps),
        "stages": rounded(timing.stages),
        "output": str(order.where.path),
        "artefacts": artefacts,
        "job": job.id,
    }


def _deliver_artefacts(farm: Farm, job: Job, order: Commission) -> dict[str, str]:
    placed: dict[str, str] = {}
    for name, path in order.artefacts.items():
        served = farm.file(job.id, name)
        at = path.absolute() if path else beside(order.where, served.filename)
        deliver(farm.read(served), Target(at, "", "file"))
        placed[name] = str(at)
    return placed
