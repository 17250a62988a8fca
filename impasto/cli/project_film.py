"""`impasto render project.zip`: paint the shots of a project one after the other, and join them with sound.

A render that is interrupted keeps the films of finished shots: the same command continues with the others.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Iterator
from pathlib import Path

from impasto.cli.console import print_status, progress
from impasto.cli.private_farm import forget, key_of, sweep, workspace
from impasto.cli.project import FilmOrder
from impasto.cli.rendering import check_consent, run
from impasto.cli.supervisor import pulse
from impasto.delivery import OutputTarget, deliver, output_faults
from pipeline.video.assembly import assemble
from pipeline.video.probe import probe
from workers.contract.request import Json
from workers.jobs.job_warnings import joining_warning
from workers.version import version


def run_film(film: FilmOrder, workers: int | None, home: Path, quiet: bool) -> Json:
    """Render the film of a project and return the summary that `--json` prints; that of a single shot is a clip's.

    Raises: as `rendering.run`.
    """
    if len(film.shots) == 1:
        with progress(quiet) as show:
            return run(film.shots[0], workers, home, show)
    began = time.monotonic()
    sweep(home)
    facts: Json = {"version": version(), "film": film.contents, "output": film.where.path, "quality": film.quality}
    with pulse(), workspace(home, f"film-{key_of(facts)}") as place:
        check_consent(film.shots[0], place)
        place.consent()
        painted = [*_painted(film, place.folder, workers, home, quiet)]
        joined = place.folder / f"film{film.where.path.suffix}"
        files = [Path(shot["output"]) for shot in painted]
        assemble(files, joined, film.where.format, film.quality, film.profile)
        info = probe(joined)
        with output_faults("--output", film.where.path):
            deliver(joined, film.where)
        forget(place.folder)
    seconds = sum(shot["seconds"] for shot in painted)
    notes = [dataclasses.asdict(joining_warning(note)) for note in film.notes]
    return {
        "frames": info.frames,
        "width": info.width,
        "height": info.height,
        "seconds": round(seconds, 4),
        "fps": round(info.frames / seconds, 3) if seconds else 0.0,
        "output": str(film.where.path),
        "shots": [{name: shot[name] for name in ("frames", "seconds", "warnings")} for shot in painted],
        "warnings": notes + [warning for shot in painted for warning in shot["warnings"]],
        "wall_seconds": round(time.monotonic() - began, 4),
    }


def _painted(film: FilmOrder, folder: Path, workers: int | None, home: Path, quiet: bool) -> Iterator[Json]:
    """The summary of each shot's render, in order. What an equal shot or an interrupted render has painted is not
    painted again."""
    for number, (order, content) in enumerate(zip(film.shots, film.contents, strict=True), start=1):
        path = folder / f"{content[:32]}{film.where.path.suffix}"
        if path.exists():
            yield {"frames": probe(path).frames, "seconds": 0.0, "output": str(path), "warnings": []}
            continue
        if not quiet:
            print_status(f"Shot {number} of {len(film.shots)}: {order.request.name}")
        where = OutputTarget(path, film.where.format, "file")
        with progress(quiet) as show:
            yield run(dataclasses.replace(order, where=where, overwrite=True), workers, home, show)
