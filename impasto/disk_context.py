"""The task context of `impasto.render`: artefacts and passes lie in a folder."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from impasto.progress import Progress
from pipeline.arrays import AnyArray
from pipeline.methods.base import AnyParams, Arrays, Method, Task
from pipeline.methods.local import FrameSource, Input, LocalContext
from workers.contract.request import OutputSpec
from workers.execution.arrays import read_arrays, write_arrays
from workers.execution.pass_files import PassWriter


class DiskContext(LocalContext[AnyParams]):
    """A context whose artefacts lie in a folder, so that memory does not grow with the length of the video."""

    def __init__(
        self, params: AnyParams, video: FrameSource, inputs: Mapping[str, Input], seed: int, *, folder: Path
    ) -> None:
        super().__init__(params, video, inputs, seed)
        self._folder = folder
        self.pass_files: list[Path] = []
        """Files with the passes of finished tasks."""
        self._start_passes: Callable[[Path], PassWriter] | None = None
        self._passes: PassWriter | None = None
        self._numbers: tuple[int, ...] = ()
        self.reports: Progress | None = None

    def planned(self, step: str, tasks: Sequence[Task]) -> None:
        if self.reports is not None:
            self.reports.planned(step, tasks)

    def progress(self, done: float) -> None:
        if self.reports is not None and self.task is not None:
            self.reports.running(self.step, self.task, done)

    def ask_for_passes(self, method: Method, output: OutputSpec, numbers: tuple[int, ...]) -> None:
        """Ask for the passes of an output. `numbers`: of the frames, in names of files; (): their indices."""
        self.passes_wanted, self._numbers = frozenset(output.passes), numbers
        made = method.passes_of(self.params)
        self._start_passes = lambda folder: PassWriter(made, output, folder, self.size)

    def emit_passes(self, index: int, made: Arrays) -> None:
        if self._passes is None and self._start_passes is not None:
            folder = self._folder / f"passes-{len(self.pass_files)}"
            folder.mkdir()
            self._passes = self._start_passes(folder)
        if self._passes is not None:
            self._passes.add(self._numbers[index] if index < len(self._numbers) else index, made)

    def finish_passes(self) -> None:
        """Complete the file of a task that has ended."""
        if self._passes is not None and (path := self._passes.finish()):
            self.pass_files.append(path)
        self._passes = None

    def save(self, name: str, arrays: Arrays) -> None:
        super().save(name, {})
        with self._path(self.step, name).open("wb") as file:
            write_arrays(file, arrays)

    def load(self, step: str, name: str) -> dict[str, AnyArray]:
        super().load(step, name)  # whether the task may
        with self._path(step, name).open("rb") as file:
            return read_arrays(file.read())

    def _path(self, step: str, name: str) -> Path:
        return self._folder / f"{step}--{name.replace('/', '--')}"
