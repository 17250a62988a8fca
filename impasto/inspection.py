"""Inspection of a sequence or video: its size, layers and passes, and the passes that each method would use."""

from __future__ import annotations

import tempfile
from contextlib import closing
from pathlib import Path
from typing import Any

from impasto.cli.input_files import gather
from pipeline.errors import BadInput
from pipeline.methods import methods
from pipeline.passes.extract import extract
from pipeline.passes.facts import sentences
from pipeline.passes.sequence import pass_sequence
from pipeline.video.guard.pictures import guarded_planes, guarded_raw
from pipeline.video.headers import sniff
from pipeline.video.probe import probe_guarded
from pipeline.video.sequence_options import USUAL, SequenceOptions
from pipeline.video.shot_files import ShotFiles

Report = dict[str, Any]


def inspect(
    path: str | Path, sequence: SequenceOptions = USUAL, extracted: dict[str, Path] | None = None
) -> Report:  # fmt: skip
    """Inspect a video, a folder, a zip or a pattern of images.

    Args:
        sequence: how images are read.
        extracted: passes to write as zips of images, see `pipeline.passes.extract`, with their paths.

    Returns:
        Facts of the file as the service stores them ("width", "frames", "fps", "numbers", "damage", "alpha", "notes",
        "passes", ...); "methods": for each method, sentences on the passes that it uses.

    Raises: BadInput, with the remedy: the file cannot be read, or lacks an extracted pass.
    """
    with tempfile.TemporaryDirectory(prefix="impasto-") as scratch:
        file = gather("PATH", Path(path), Path(scratch), sequence)
        info = probe_guarded(file.path)
        _extract(file.path, extracted or {})
    report = {"path": str(path), **info.as_json()}
    report["notes"] = [*info.notes, *(note.message for note in file.notes)]
    report["methods"] = {name: list(sentences(info.passes, each.passes)) for name, each in methods().items()}
    return report


def _extract(archive: Path, wanted: dict[str, Path]) -> None:
    if not wanted:
        return
    with archive.open("rb") as stream:
        is_zip = sniff(stream) == "application/zip"
    if is_zip:
        with closing(ShotFiles(archive)) as files:
            if (passes := pass_sequence(files, guarded_planes, guarded_raw)) is not None:
                for what, path in wanted.items():
                    extract(passes, what, path)
                return
    raise BadInput("The file has no render passes.", field="PATH", remedy="Give numbered images with several layers.")
