"""The work of `impasto batch`: shots that are not painted yet are painted, each into a new version."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from impasto.batch.cut import SUFFIXES as CUTS
from impasto.batch.cut import cut_shots
from impasto.batch.ledger import Ledger, Result, key_of
from impasto.batch.looks import Config, Look
from impasto.batch.manifest import SUFFIXES as MANIFESTS
from impasto.batch.manifest import manifest_shots
from impasto.batch.shots import Media, Shot, folder_shots
from impasto.delivery import OutputTarget, expanded, target
from impasto.ranges import facts_of
from pipeline.errors import BadInput, BadParameter, ImpastoError
from workers.contract.request import JobRequest, Json, OutputSpec
from workers.version import version


@dataclass(frozen=True)
class Plan:
    """A shot that is to be painted: its request without asset ids, its inputs and its output."""

    shot: Shot
    key: str
    version: int
    request: JobRequest
    paths: Mapping[str, Path]
    where: OutputTarget
    notes: tuple[str, ...]


Paint = Callable[[Plan], Json]
"""Paints a plan into its output; returns at least `frames` and `warnings`."""


FPS_FROM_USER = MANIFESTS | {".edl"}
"""Files that name no frame rate: of its events, or of numbered images."""


def shots_of(source: Path, config: Config) -> list[Shot]:
    """The shots of a cut, a manifest or a folder of films. Raises BadInput."""
    suffix = source.suffix.lower()
    if source.is_dir():
        return folder_shots(source)
    if not source.is_file():
        raise BadInput("File or folder not found.", field="CUT", value=source, remedy="Check the path.")
    media = Media([expanded(folder) for folder in (*config.media, source.parent)])
    if suffix in CUTS:
        return cut_shots(source, media, config.fps)
    if suffix in MANIFESTS:
        return manifest_shots(source, media, config.fps)
    known = ", ".join(sorted(CUTS | MANIFESTS))
    raise BadInput(
        "It is neither a cut nor a manifest.", field="CUT", value=source, remedy=f"Give {known}, or a folder."
    )


class Batch:
    """One batch into one output folder.

    Args:
        base: folder that inputs of looks are relative to.
    """

    def __init__(self, config: Config, output: Path, base: Path) -> None:
        self._config, self._output, self._base = config, output, base
        self.ledger = Ledger(output)
        self._failed: dict[str, ImpastoError] = {}

    def run(self, shots: Sequence[Shot], paint: Paint) -> Iterator[Json]:
        """Paint what is not done; yields a row for each shot: shot, state (painted, done or failed), output, ...

        A shot that fails does not stop the others: its row has the `error`, and it is tried again in another batch, or
        when its inputs or its look change. `known`: the row is that of an earlier run.

        Raises BadParameter: two shots have the same name.
        """
        self._check_names(shots)
        for shot in shots:
            try:
                yield self._one(shot, paint)
            except ImpastoError as error:
                if error.code in ("interrupted", "cancelled"):
                    raise
                yield {"shot": shot.name, "state": "failed", "error": error}
        self.ledger.save()

    def _one(self, shot: Shot, paint: Paint) -> Json:
        name, look = self._config.look_of(shot.name, shot.look, shot.changes)
        handles = self._config.handles if shot.handles is None else shot.handles
        inputs = {role: self._base / expanded(path) for role, path in look.inputs.items()}
        key = self._key(shot, look, handles, inputs)
        if (done := self.ledger.get(key)) is not None:
            row = {"shot": shot.name, "state": "done", "output": str(self._output / done.output)}
            return row | {"frames": done.frames, "known": True}
        if key in self._failed:
            return {"shot": shot.name, "state": "failed", "error": self._failed[key], "known": True}
        try:
            return self._paint(self._plan(shot, key, (name, look), handles, inputs), paint)
        except ImpastoError as error:
            self._failed[key] = error
            raise

    def _paint(self, plan: Plan, paint: Paint) -> Json:
        summary, name, at = paint(plan), plan.shot.name, plan.where.path
        kept = at.relative_to(self._output).as_posix()
        self.ledger.add(plan.key, Result(name, plan.version, kept, summary["frames"]))
        warnings = [*plan.notes, *(warning["message"] for warning in summary["warnings"])]
        row = {"shot": name, "state": "painted", "output": str(at), "frames": summary["frames"]}
        return row | {"source_frames": plan.request.frames, "warnings": warnings}

    def _key(self, shot: Shot, look: Look, handles: int, inputs: Mapping[str, Path]) -> str:
        handles = handles if shot.span else 0
        contents = {role: self.ledger.content(path) for role, path in {**inputs, "video": shot.source}.items()}
        span = None if shot.span is None else vars(shot.span)
        suffix = self._config.names.rpartition(".")[2]
        return key_of({
            "version": version(), "shot": shot.name, "inputs": contents, "span": span, "handles": handles,
            "look": look.model_dump(exclude={"inputs"}), "format": suffix,
            **({"sequence": shot.sequence.given} if shot.sequence.given else {}),
        })  # fmt: skip

    def _plan(self, shot: Shot, key: str, named: tuple[str, Look], handles: int, inputs: Mapping[str, Path]) -> Plan:
        look_name, look = named
        frames, notes = shot.frames(facts_of(shot.source, shot.sequence), handles)
        number_at = self._names_of(shot, look_name, look)
        number = self.ledger.version_of(key, shot.name, lambda version: _stands(number_at(version)))
        where = target(number_at(number), "names")
        output = OutputSpec(where.format, look.quality, profile=look.profile, alpha=look.alpha)
        request = JobRequest(
            look.method, {}, look.params, look.seed, output, name=f"{shot.name} v{number:03d}", frames=frames,
            on_damage=look.on_damage,
            labels={"batch": shot.tokens.get("cut", "")[:64] or "batch", "shot": shot.name[:64]},
        )  # fmt: skip
        return Plan(shot, key, number, request, {"video": shot.source, **inputs}, where, (*shot.notes, *notes))

    def _names_of(self, shot: Shot, look_name: str, look: Look) -> Callable[[int], str]:
        """Version -> path of the result, as text."""
        tokens = {"cut": "", "event": "001", "clip": shot.source.stem, "reel": "none"} | dict(shot.tokens)
        tokens |= {"shot": shot.name, "source": shot.source.stem, "look": look_name, "method": look.method}
        return lambda number: str(self._inside(self._config.names.format(**tokens, version=f"{number:03d}")))

    def _inside(self, name: str) -> Path:
        """A path in the output folder. Raises BadParameter: the name leads out of it."""
        path = Path(os.path.normpath(name))
        if path.is_absolute() or ".." in path.parts:
            raise BadParameter("The name leads out of the output folder.", field="names", value=name,
                               remedy="Give the shot a name without '..'.")  # fmt: skip
        return self._output / path

    def _check_names(self, shots: Sequence[Shot]) -> None:
        named: dict[str, str] = {}
        for shot in shots:
            path = self._names_of(shot, *self._config.look_of(shot.name, shot.look, shot.changes))(1)
            if path in named:
                raise BadParameter(
                    f"Two shots have one name: {named[path]} and {shot.name}.", field="names",
                    value=self._config.names, remedy="Add {shot}.",
                )  # fmt: skip
            named[path] = shot.name


def _stands(text: str) -> bool:
    """Whether a result of that name exists: a file, or the folder of a pattern."""
    path = Path(text)
    return path.exists() or ("#" in path.name and path.parent.is_dir() and any(path.parent.iterdir()))


def described(row: Mapping[str, Any]) -> str:
    """A row as a line of text."""
    if row["state"] == "failed":
        return f"{row['shot']}: failed: {row['error']}"
    return f"{row['shot']}: {row['state']}, {row['frames']} frames, {row['output']}"
