"""The platform's own last step of every job: segments become the finished file, its poster, sheet and report."""

from __future__ import annotations

import json
import shutil
import zipfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import IO

from pipeline.errors import UnreadableMedia
from pipeline.formats import IN_FILM, output_format
from pipeline.frames import Frame
from pipeline.methods import parse_params
from pipeline.methods.base import Method, TaskResult
from pipeline.passes.made import PASSES
from pipeline.quality.report import QualityReport
from pipeline.video.contact_sheet import contact_sheet, poster
from pipeline.video.guard.files import guarded_join
from pipeline.video.media import Note
from pipeline.video.reader import VideoReader
from pipeline.video.writer import zip_entry
from workers.blobs.base import Blobs
from workers.contract.order import CPU, PEAK_MEMORY, TaskOrder
from workers.contract.request import Json
from workers.execution.context import PART
from workers.execution.decoders import Decoders
from workers.execution.pass_files import add_to_film, unite
from workers.execution.result_quality import ResultQuality

Files = dict[str, tuple[str, str]]
"""Downloadable name -> (blob key, media type)."""
_COPY_BYTES = 1 << 20


class Assembly:
    """Makes a job's files from the results of its tasks. The files are blobs in the folder of the job's last step.

    Args:
        overview: whether the files include a poster and a contact sheet.
    """

    def __init__(
        self, order: TaskOrder, chosen: Method, blobs: Blobs, decoders: Decoders, scratch: Path, overview: bool = True
    ) -> None:  # fmt: skip
        self._order = order
        self._method = chosen
        self._blobs = blobs
        self._decoders = decoders
        self._scratch, self._overview = scratch, overview
        self._prefix = f"jobs/{order.job_id}/{order.step}/{order.key}/{order.attempt_id}"
        self._format = output_format(order.output.format)
        self._suffix = (*self._format.suffixes, ".zip")[0]
        self._profile = self._format.profile(order.output.profile).name
        self.files: Files = {}
        self.missing: list[str] = []
        """Requested artefacts of which no task has made a part."""
        self.notes: list[Note] = []
        """Notes on what was chosen, corrected, assumed or left out of the source."""

    def run(self, progress: Callable[[float], None]) -> TaskResult:
        """Join, describe, pack. Raises UnreadableMedia if no task emitted a frame."""
        joined = self._join(lambda done: progress(0.8 * done))
        if self._order.output.passes_format == IN_FILM:
            joined = self._with_passes(joined)
        quality, tiles = self._quality(joined) if self._order.output.report else (None, {})
        result = self._describe(joined, tiles)
        if quality is not None:
            result["quality"] = quality.summary()
        progress(0.9)
        self._put("result", f"result{self._suffix}", joined, self._format.media_type)
        for artefact in self._order.output.artefacts:
            self._pack(artefact)
        if self._order.output.passes and self._order.output.passes_format != IN_FILM:
            self._pack(PASSES)
        facts = self._report(result) | ({"quality": quality.as_json()} if quality is not None else {})
        report = json.dumps(facts, indent=2, sort_keys=True).encode()
        self._put("report", "report.json", report, "application/json")
        progress(1.0)
        return result

    def _join(self, progress: Callable[[float], None]) -> Path:
        segments = sorted(s for s in self._order.segments if s[2])
        if not segments:
            raise UnreadableMedia("The video has no frames.", field="inputs.video", remedy="Use another video.")
        out = self._scratch / f"result{self._suffix}"
        with ExitStack() as stack:
            first = self._order.frames[0] if self._order.frames else 0
            starts, end = self._times_s([max(start, first) for start, _stop, _key in segments])
            paths = [stack.enter_context(self._blobs.local(key)) for _start, _stop, key in segments]
            sound = stack.enter_context(self._blobs.local(self._order.inputs["video"]))
            pieces = list(zip(starts, paths, strict=True))
            self.notes += guarded_join(
                pieces, out, self._format.name, sound, progress, end, self._order.source, self._order.output.quality
            )
        return out

    def _times_s(self, frames: list[int]) -> tuple[list[Fraction], Fraction | None]:
        """Presentation times of these source frames, seconds, and the end of the job's piece of the source, if any."""
        with self._decoders.reader(self._order.inputs["video"], 0, self._order.reading) as reader:
            self.notes += [*reader.notes, *self._opacity_notes(reader.has_alpha)]
            index, piece = reader.index, self._order.frames
            end = None if piece is None else index.time(min(piece[1], len(index.pts))) * index.time_base
            return [index.time(frame) * index.time_base for frame in frames], end

    def _opacity_notes(self, source_has_alpha: bool) -> list[Note]:
        if self._order.output.alpha != "source" or source_has_alpha or self._method.opacity_of != "video":
            return []
        return [Note("left-out", "The video has no opacity: the film is opaque.")]

    def _describe(self, result: Path, tiles: Mapping[int, Frame]) -> TaskResult:
        with VideoReader(result) as reader:
            if self._overview:
                self._put("poster", "poster.jpg", poster(reader), "image/jpeg")
                self._put("sheet", "sheet.jpg", contact_sheet(reader, known=tiles), "image/jpeg")
            width, height = reader.size
            fps, seconds = (
                (reader.fps, reader.index.duration_s) if not self._format.frame_suffixes else self._source_pace()
            )
            return {
                "frames": reader.frames,
                "width": width,
                "height": height,
                "fps": round(fps, 6),
                "duration_s": round(seconds, 6),
                "size_bytes": result.stat().st_size,
            }

    def _source_pace(self) -> tuple[float, float]:
        info = self._order.input_info["video"]
        return float(info["fps"]), float(info["duration_s"])

    def _quality(self, result: Path) -> tuple[QualityReport, Mapping[int, Frame]]:
        """The report, and frames of the contact sheet that were decoded for it."""
        measuring = ResultQuality(self._order, self._method, self._blobs, self._decoders, self._scratch)
        return measuring.measure(result, parse_params(self._method, self._order.params)), measuring.tiles

    def _report(self, result: TaskResult) -> Json:
        order = self._order
        return {
            "method": order.method,
            "params": order.params,
            "seed": order.seed,
            "output": {"format": order.output.format, "profile": self._profile, "quality": order.output.quality},
            "result": result,
            "steps": order.results,
            "seconds": {step: _stages(measures) for step, measures in order.stages.items()},
            "cpu_s": {step: measures[CPU] for step, measures in order.stages.items() if CPU in measures},
            "peak_bytes": {
                step: int(measures[PEAK_MEMORY]) for step, measures in order.stages.items() if PEAK_MEMORY in measures
            },
        }

    def _pack(self, artefact: str) -> None:
        """Join the parts of an artefact that tasks have saved as files, in the order of their names."""
        if not (parts := self._parts(artefact)):
            return
        path = self._scratch / f"{artefact}.zip"
        if artefact == PASSES:
            unite([partial(self._blobs.local, key) for _, key in parts], path)
        else:
            with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as target:
                for name, key in parts:
                    with self._blobs.local(key) as part:
                        _add_part(target, name, part)
        self._put(artefact, f"{artefact}.zip", path, "application/zip")

    def _with_passes(self, film: Path) -> Path:
        """The film with the passes in its images."""
        if not (parts := self._parts(PASSES)):
            return film
        passes, out = self._scratch / PASSES, self._scratch / f"with-{PASSES}{self._suffix}"
        unite([partial(self._blobs.local, key) for _, key in parts], passes)
        add_to_film(film, passes, out)
        return out

    def _parts(self, artefact: str) -> list[tuple[str, str]]:
        """(name, blob key) of the parts of an artefact, sorted; it is missing if there are none."""
        parts = sorted(
            (name.partition(f"/{PART}")[2], key)
            for name, key in self._order.artefacts.items()
            if f"/{PART}{artefact}-" in name
        )
        if not parts:
            self.missing.append(artefact)
        return parts

    def _put(self, name: str, file: str, data: bytes | Path, media_type: str) -> None:
        key = f"{self._prefix}/{file}"
        self._blobs.put(key, data)
        self.files[name] = (key, media_type)


def _stages(measures: Mapping[str, float]) -> dict[str, float]:
    return {name: seconds for name, seconds in measures.items() if name not in (CPU, PEAK_MEMORY)}


def _add_part(target: zipfile.ZipFile, name: str, part: Path) -> None:
    """Entries of one part: those of the zip, or the part itself if it is no zip."""
    for entry_name, stream in _entries(name, part):
        entry = zip_entry(entry_name)
        entry.compress_type = zipfile.ZIP_DEFLATED
        with stream, target.open(entry, "w", force_zip64=True) as out:
            shutil.copyfileobj(stream, out, _COPY_BYTES)


def _entries(name: str, part: Path) -> Iterator[tuple[str, IO[bytes]]]:
    if not zipfile.is_zipfile(part):
        yield name, part.open("rb")
        return
    with zipfile.ZipFile(part) as source:
        for member in source.infolist():
            yield member.filename, source.open(member)
