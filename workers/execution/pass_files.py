"""The passes of a job's method: a task writes those of its frames, and the last step unites them by frame."""

from __future__ import annotations

import zipfile
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, ExitStack
from pathlib import Path

from pipeline.arrays import Arrays
from pipeline.errors import BadParameter
from pipeline.formats import has_planes, planes_format
from pipeline.passes.made import PASSES, MadePass
from pipeline.passes.pass_archive import PassArchive
from pipeline.video.writer import zip_entry
from workers.contract.request import OutputSpec


class PassWriter:
    """Passes that one task makes, in a file.

    Args:
        folder: where the file is written; the task's own.
        size: (width, height) of the frames, px.
    """

    def __init__(self, made: Sequence[MadePass], output: OutputSpec, folder: Path, size: tuple[int, int]) -> None:
        self._made, self._output, self._size = made, output, size
        self._path = folder / PASSES
        self._archive: PassArchive | None = None

    def add(self, number: int, arrays: Arrays) -> None:
        """Add the passes of a frame. `number`: in the names of files. Raises BadParameter for one that was not asked
        for."""
        for name in arrays:
            if name not in self._output.passes:
                raise BadParameter("The job does not ask for this pass.", field="emit_passes", value=name)
        if arrays and self._archive is None:
            self._archive = PassArchive(self._path, self._made, self._output.passes_format, self._size)
        if arrays and self._archive is not None:
            self._archive.add(number, arrays)

    def finish(self) -> Path | None:
        """The complete file; None: there are no passes."""
        if self._archive is None:
            return None
        self._archive.close()
        return self._path


def add_to_film(film: Path, passes: Path, out: Path) -> None:
    """Write the film, a zip of images with planes, with the passes of each frame as layers in its image.

    Args:
        passes: of `unite`. Frames are found by their numbers.
    """
    with zipfile.ZipFile(film) as pictures, zipfile.ZipFile(passes) as layers, zipfile.ZipFile(out, "w") as target:
        found = {int(Path(name).stem): name for name in layers.namelist()}
        for name in pictures.namelist():
            data = pictures.read(name)
            layer = found.get(int(Path(name).stem)) if has_planes(name) else None
            united = data if layer is None else planes_format().with_planes(data, layers.read(layer))
            target.writestr(zip_entry(name), united)


Part = Callable[[], AbstractContextManager[Path]]


def unite(parts: Sequence[Part], path: Path) -> None:
    """Write one zip with the entries of several, in the order of their names; images of one name, which several tasks
    have made of a frame, become one image with all planes. Few parts are open at a time."""
    owners: dict[str, list[int]] = {}
    for number, part in enumerate(parts):
        with part() as file, zipfile.ZipFile(file) as archive:
            for name in archive.namelist():
                owners.setdefault(name, []).append(number)
    last = {number: name for name in sorted(owners) for number in owners[name]}
    opened: dict[int, tuple[ExitStack, zipfile.ZipFile]] = {}
    with zipfile.ZipFile(path, "w") as target, ExitStack() as all_parts:
        for name in sorted(owners):
            files = []
            for number in owners[name]:
                if number not in opened:
                    stack = all_parts.enter_context(ExitStack())
                    opened[number] = stack, stack.enter_context(zipfile.ZipFile(stack.enter_context(parts[number]())))
                files.append(opened[number][1].read(name))
            united = planes_format().united(files) if len(files) > 1 and has_planes(name) else files[0]
            target.writestr(zip_entry(name), united)
            for number in [number for number in owners[name] if last[number] == name]:
                opened.pop(number)[0].close()
