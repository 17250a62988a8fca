"""Every way to ask for a film, as functions from a case to its frames by number."""

from __future__ import annotations

import tempfile
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import impasto
from impasto import NoEffect
from pipeline.errors import ImpastoError
from pipeline.frames import Frame
from pipeline.methods import method, parse_params
from pipeline.methods.layers import LAYERS
from pipeline.methods.layers.names import input_name
from pipeline.methods.local import LocalContext, run_plan
from pipeline.video.reader import VideoReader
from tests.laws.cases import Case

Frames = dict[int, Frame]


def film(case: Case) -> Frames:
    """The film, by the method's plan in memory."""
    context = LocalContext(case.parsed, case.film(), case.given(), seed=case.seed)
    run_plan(case.chosen, context)
    return context.emitted


class Films:
    """Films of cases. Each is painted once, however many laws need it."""

    def __init__(self) -> None:
        self._painted: dict[str, Frames | str] = {}

    def __call__(self, case: Case) -> Frames | str:
        """The film, or why the case has none: it must then be a fault that its own error names."""
        if (name := repr(case)) not in self._painted:
            try:
                self._painted[name] = film(case)
            except ImpastoError as error:
                self._painted[name] = f"{error.field}: {error.message}"
        return self._painted[name]


def piece(case: Case) -> Frames:
    """The piece of the film, by the plan."""
    context = LocalContext(case.parsed, case.film(), case.given(), seed=case.seed, piece=case.piece)
    run_plan(case.chosen, context)
    return context.emitted


def shuffled(case: Case) -> Frames:
    """The film, its tasks in another order, as on many workers."""
    context = LocalContext(case.parsed, case.film(), case.given(), seed=case.seed)
    run_plan(case.chosen, context, shuffle=case.seed)
    return context.emitted


def layer(case: Case) -> Frames:
    """The film as the only layer of a project's shot."""
    chosen, row = method(LAYERS), {"method": case.method, "params": case.params, "seed": case.seed}
    inputs = {input_name(0, name): given for name, given in case.given().items()}
    context = LocalContext(parse_params(chosen, {"layers": [row]}), case.film(), inputs, seed=case.seed)
    run_plan(chosen, context)
    return context.emitted


def iterator(case: Case) -> Frames:
    """The film of the library call from frames as they arrive."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NoEffect)
        frames = impasto.render(case.method, iter(case.film()), inputs=_library(case), seed=case.seed, **case.params)
        return dict(enumerate(frames))


def library(case: Case) -> Frames:
    """The film of the library call in a file without loss."""
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        out = Path(folder) / "film.zip"
        impasto.render(case.method, case.film(), out, inputs=_library(case), seed=case.seed, **case.params)
        with VideoReader(out) as reader:
            return dict(enumerate(reader.read(0, None)))


def live(case: Case) -> Frames:
    """The frames of a live session."""
    given = case.given()
    references: dict[str, Iterator[Frame]] = {name: iter(given[name]) for name in case.inputs}  # type: ignore[arg-type]
    session = case.chosen.stream(case.parsed, (case.film()[0].shape[1], case.film()[0].shape[0]), case.seed, references)
    assert session is not None
    return {index: session.step(frame) for index, frame in enumerate(case.film())}


def _library(case: Case) -> Mapping[str, Any]:
    """Inputs as the library accepts them: documents, images by frame, lists of pictures."""
    return case.given()


def any_case(case: Case) -> bool:
    """For ways that accept every case."""
    return True


def is_live(case: Case) -> bool:
    """Whether a live session has everything of the case."""
    kinds = {spec.name: spec.kind for spec in case.chosen.inputs}
    if any(kinds[name] not in ("image", "image-or-video") for name in case.inputs):
        return False
    given = {"video", *case.inputs}
    lost = {found.field for found in case.chosen.ineffective(case.parsed, given, True, False)}
    whole = {found.field for found in case.chosen.ineffective(case.parsed, given, False, False)}
    size = (case.film()[0].shape[1], case.film()[0].shape[0])
    return lost <= whole and case.chosen.stream(case.chosen.Params(), size, 0, {}) is not None


@dataclass(frozen=True)
class WayToAsk:
    """A way that gives the frames of the film.

    Attributes:
        takes: whether it has everything of a case; other cases it must refuse by name.
    """

    name: str
    frames: Callable[[Case], Frames]
    takes: Callable[[Case], bool] = any_case


WAYS = (
    WayToAsk("shuffled", shuffled), WayToAsk("layer", layer), WayToAsk("iterator", iterator),
    WayToAsk("library", library), WayToAsk("live", live, is_live),
)  # fmt: skip


def difference(one: Frames, other: Frames) -> float:
    """Mean difference of the frames that both have, gray levels; infinite, if one lacks a frame of `one`."""
    if one.keys() - other.keys():
        return float("inf")
    return max((float(np.abs(one[k].astype(np.int16) - other[k]).mean()) for k in one), default=0.0)
