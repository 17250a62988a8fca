"""`impasto render --estimate`: estimates the cost of a render from earlier renders on this machine."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from pipeline.video.media import MediaInfo
from pipeline.video.probe import probe_guarded
from workers.contract.record import Job
from workers.contract.request import JobRequest, Json
from workers.jobs.estimates import MeasuredJob, estimate
from workers.jobs.frame_window import window_info

HISTORY = "render-history.json"
"""File of finished renders in the home folder."""
MAX_KEPT = 200
"""Maximum number of renders that are kept, the newest first."""


def estimate_render(request: JobRequest, video: Path, home: Path) -> Json:
    """Estimated time, memory and disk space of a render of the video, as the fields of `Estimate`.

    Raises: UnreadableMedia, NoVideoStream, BadParameter (the video has no such stream).
    """
    info, history = _facts(probe_guarded(video)), _read(home)
    return dataclasses.asdict(estimate(request, info, lambda method: history.get(method, [])))


def summed(found: Sequence[Json]) -> Json:
    """The estimate of several renders, one after the other; unknown if one of them is."""
    first, *others = found
    for one in others:
        first = {name: _sum(name, first[name], one[name]) for name in first}
    return first


def _sum(name: str, one: float | None, other: float | None) -> float | None:
    if one is None or other is None:
        return None
    if name == "memory_bytes":
        return max(one, other)
    return min(one, other) if name == "samples" else one + other


def remember(home: Path, request: JobRequest, video: MediaInfo, job: Job) -> None:
    """Add a finished render to the history. A history that cannot be written does not change."""
    if job.started_at is None or job.finished_at is None:
        return
    piece = window_info(_facts(video), request.frames)
    measured = MeasuredJob(
        request.params, int(piece["frames"]), int(piece["width"]) * int(piece["height"]),
        job.finished_at - job.started_at, sum(step.cpu_s for step in job.steps),
        max((step.peak_bytes for step in job.steps), default=0),
    )  # fmt: skip
    rows = [{"method": request.method, **dataclasses.asdict(measured)}, *_rows(home)][:MAX_KEPT]
    part = home / f".{HISTORY}.part"
    with suppress(OSError):
        home.mkdir(parents=True, exist_ok=True)
        part.write_text(json.dumps(rows, indent=1))
        part.replace(home / HISTORY)


def _facts(video: MediaInfo) -> Json:
    return {name: getattr(video, name) for name in ("frames", "width", "height", "fps", "duration_s", "streams")}


def _read(home: Path) -> dict[str, list[MeasuredJob]]:
    """Measured renders by method, the newest first."""
    found: dict[str, list[MeasuredJob]] = {}
    names = {field.name for field in dataclasses.fields(MeasuredJob)}
    for row in _rows(home):
        if isinstance(row, dict) and names | {"method"} == set(row):
            measured = MeasuredJob(**{name: row[name] for name in names})
            if measured.frames > 0 and measured.pixels > 0:
                found.setdefault(row["method"], []).append(measured)
    return found


def _rows(home: Path) -> list[Json]:
    try:
        rows = json.loads((home / HISTORY).read_text())
    except (OSError, ValueError):
        return []
    return rows if isinstance(rows, list) else []
