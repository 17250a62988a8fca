"""Inputs of an attempt that are read as files: JSON, pictures, shot files. Frames are read by the context."""

from __future__ import annotations

import json
from collections.abc import Mapping
from contextlib import ExitStack
from typing import cast

from pydantic import JsonValue

from pipeline.arrays import AnyArray
from pipeline.errors import BadParameter
from pipeline.formats import IMAGES
from pipeline.video.guard.files import GuardedImages
from pipeline.video.headers import sniff
from pipeline.video.numbered import by_frame
from pipeline.video.numbering import numbers_of_runs
from pipeline.video.shot_files import ShotFiles
from workers.blobs.base import Blobs
from workers.contract.order import TaskOrder
from workers.execution.reuse import ReadRecord, RecordedImages


class InputFiles:
    """Opens the inputs of an order; `reads` records what was read. For the meaning of each method see
    `pipeline.methods.base.TaskContext`. Close it."""

    def __init__(self, order: TaskOrder, blobs: Blobs) -> None:
        self._order, self._blobs = order, blobs
        self._open = ExitStack()
        self._pictures: dict[str, Mapping[int, AnyArray]] = {}
        self.reads = ReadRecord(order, self._images, {})

    def close(self) -> None:
        self._open.close()

    def has(self, name: str) -> bool:
        self.reads.record(f"has {name}")
        return name in self._order.inputs

    def key(self, name: str, whole: bool = True) -> str:
        """Blob key of an input. `whole`: the task may read all of it."""
        if whole:
            self.reads.record(f"input {name}")
        if name not in self._order.inputs:
            raise BadParameter(
                f"The input {name!r} is needed and was not given.",
                field=f"inputs.{name}",
                remedy=f"Upload it and name it in the job's inputs as {name!r}.",
            )
        return self._order.inputs[name]

    def json(self, name: str) -> JsonValue:
        try:
            return cast("JsonValue", json.loads(self._blobs.get(self.key(name))))
        except ValueError as error:
            raise BadParameter(f"The input is not JSON: {error}.", field=f"inputs.{name}") from None

    def images(self, name: str) -> Mapping[int, AnyArray]:
        return RecordedImages(name, self._images(name), self.reads)

    def _images(self, name: str) -> Mapping[int, AnyArray]:
        if name not in self._pictures:
            path = self._open.enter_context(self._blobs.local(self.key(name, whole=False)))
            found = GuardedImages(path, f"inputs.{name}")
            self._open.callback(found.close)
            self._pictures[name] = by_frame(found, self._numbers(), f"inputs.{name}")
        return self._pictures[name]

    def _numbers(self) -> tuple[int, ...]:
        """Numbers of the frames of the source, if it is a sequence of images."""
        return tuple(numbers_of_runs(self._order.input_info["video"].get("numbers", ())))

    def entries(self, name: str) -> Mapping[str, bytes]:
        path = self._open.enter_context(self._blobs.local(self.key(name)))
        with path.open("rb") as stream:
            if (found_type := sniff(stream)) != "application/zip":
                form = next((form for form in IMAGES if form.media_type == found_type and form.carries.planes), None)
                return {} if form is None else {f"{name}{form.suffixes[0]}": path.read_bytes()}
        found = ShotFiles(path)
        self._open.callback(found.close)
        return found
