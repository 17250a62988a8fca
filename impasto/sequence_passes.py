"""The render passes of a sequence that is painted in this process."""

from __future__ import annotations

import tempfile
import zipfile
from collections.abc import Collection, Iterable, Mapping
from contextlib import ExitStack
from pathlib import Path

from impasto.cli.input_files import gather
from pipeline.formats import has_planes
from pipeline.methods.applies import Ineffective
from pipeline.methods.base import AnyParams, Method
from pipeline.passes.sequence import pass_sequence
from pipeline.video.guard.pictures import guarded_planes, guarded_raw
from pipeline.video.numbering import is_pattern
from pipeline.video.sequence_options import SequenceOptions
from pipeline.video.shot_files import ShotFiles


def files_with_passes(path: str | Path, options: SequenceOptions, stack: ExitStack) -> Mapping[str, bytes]:
    """The files of a folder, zip or pattern of images with render passes; empty: it is something else.

    Args:
        stack: closes the files.
    """
    if not any(map(has_planes, _names(Path(path)))):
        return {}
    scratch = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="impasto-")))
    files = ShotFiles(gather("source", Path(path), scratch, options).path)
    stack.callback(files.close)
    return {} if pass_sequence(files, guarded_planes, guarded_raw) is None else files


def unused_beside_passes(
    chosen: Method, params: AnyParams, inputs: Collection[str], files: Mapping[str, bytes]
) -> Iterable[Ineffective]:
    """Parameters without effect beside the passes of the video's files, which have one without these."""
    found = pass_sequence(files, guarded_planes, guarded_raw)
    kinds = () if found is None else found.facts().kinds
    known = {one.field for one in chosen.ineffective(params, inputs, False, False)}
    beside = chosen.ineffective(params, inputs, False, False, video_passes=kinds)
    return [one for one in beside if one.field not in known]


def _names(path: Path) -> Iterable[str]:
    """Names of the files of a zip, of a folder, or of the folder of a pattern."""
    if zipfile.is_zipfile(path):
        with zipfile.ZipFile(path) as archive:
            return archive.namelist()
    folder = path if path.is_dir() else path.parent
    return [p.name for p in (*folder.glob("*"), *folder.glob("*/*"))] if path.is_dir() or is_pattern(path.name) else []
