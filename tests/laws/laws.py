"""The laws as functions of a case: each returns a sentence if the case breaks it, otherwise nothing."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, get_args

import numpy as np

from pipeline.compositing import Blend
from tests.laws import ways
from tests.laws.cases import SEE_LEAD, Case, drawn_value, generated, mattes, properties_of
from tests.laws.stage import Layer, Stage, composited_film
from tests.laws.ways import WAYS, Films, difference

Verdict = str | None
HALF, LAYERED, FORGETFUL = 0.25, 0.3, 0.1
"""Shares of the cases whose stage has half the size, of the others whose shot has two layers, and of all whose stage
keeps hardly anything between tasks."""
OTHER_SEED = 1 << 32


def piece_is_film(case: Case, films: Films) -> Verdict:
    """Frames [a, b) painted alone are those of the film."""
    film = films(case)
    if isinstance(film, str):
        return None
    if "preroll" in case.chosen.Params.model_fields:
        case = case.with_params(preroll=SEE_LEAD)
    piece = ways.piece(case)
    if sorted(piece) != list(range(*case.piece)):
        return f"the piece {case.piece} has the frames {sorted(piece)}"
    found = difference(piece, film)
    return f"the piece {case.piece} differs by {found:.2f} levels" if found and is_exact(case) else None


def is_exact(case: Case) -> bool:
    """Whether a piece has the bytes of the film: it paints the memory of the film, or depends on drawn keys only."""
    params, given = case.parsed, set(case.inputs)
    if "preroll" in type(params).model_fields or params.temporal == "off":
        return True
    keyed = given >= {"keyframes"} and (not case.cut or (1 < case.cut <= 4 < case.frames))
    return keyed or bool(given & {"masks", "labels", "label_intervals", "styles"} and case.method == "patches")


def preview_is_film(case: Case, films: Films) -> Verdict:
    """What the stage shows of any frame is the film's picture at full size; at half size it is what the film's plan
    paints on pictures of half the size."""
    film = films(case)
    if isinstance(film, str):
        return None
    draw = np.random.default_rng(case.seed)
    whole = max(case.size)
    small = {"cache_bytes": 100_000, "disk_bytes": 1} if draw.random() < FORGETFUL else {}
    given: dict[str, Any] = {"drawn": bool(draw.random() < 0.5), **small}
    asked = [int(number) for number in draw.choice(case.frames, size=1 if small else 2, replace=False)]
    if draw.random() < HALF:
        half = Stage([Layer(case)], whole // 2, **given)
        film, stage = half.plan(), half
    elif draw.random() < LAYERED:
        stage = Stage(shot_of(case, draw), whole, **given)
        if isinstance(films(stage.layers[1].case), str):
            return None
        film = composited_film(stage.layers)
    else:
        stage = Stage([Layer(case)], whole, **given)
    found = difference(stage.frames(asked), film)
    return f"the stage at {stage.side_px} px shows {found:.2f} levels of difference in {asked}" if found else None


def shot_of(case: Case, draw: np.random.Generator) -> list[Layer]:
    """The case below a layer of another method, or of the same, over the same video."""
    other = generated(case.seed + OTHER_SEED)
    above = replace(other, seed=case.seed, frames=case.frames, cut=case.cut, scale=case.scale, light=case.light)
    rows = [(case, False), (above, bool(draw.random() < 0.3))]
    blends = get_args(Blend)
    looks = [(float(draw.choice([0.4, 1.0])), blends[int(draw.integers(len(blends)))]) for _ in rows]
    return [Layer(one, *look, mattes(one) if cut else None) for (one, cut), look in zip(rows, looks, strict=True)]


def every_way_is_the_same(case: Case, films: Films) -> Verdict:
    """Each way has the frames of the film, or refuses by name what it cannot do."""
    film = films(case)
    if isinstance(film, str):
        return None
    way = WAYS[case.seed % len(WAYS)]
    if not way.takes(case):
        return None
    found = difference(film, way.frames(case))
    return f"the way {way.name} differs by {found:.2f} levels" if found else None


def idle_is_said(case: Case, films: Films) -> Verdict:
    """What is said to have no effect has none. (What has one is checked for every parameter and input by itself.)"""
    draw = np.random.default_rng(case.seed)
    properties = properties_of(case.chosen)
    conditions = case.chosen.Params.applies_when
    names = sorted(conditions) or sorted(properties)
    name = names[int(draw.integers(len(names)))]
    changed = case.with_params(**{name: drawn_value(properties[name], name, draw)})
    idle = {found.field for found in changed.chosen.ineffective(changed.parsed, {"video", *case.inputs}, False, False)}
    if isinstance(films(case), str) or f"params.{name}" not in idle:
        return None
    plain = films(replace(case, params={k: v for k, v in case.params.items() if k != name}))
    other = films(changed)
    if isinstance(plain, str) or isinstance(other, str):
        return f"{name} is said to have no effect, and with one of its values the film fails: {plain} {other}"
    found = difference(plain, other)
    return f"{name} is said to have no effect, and changes {found:.2f} levels" if found else None


LAWS: Mapping[str, Callable[[Case, Films], Verdict]] = {
    law.__name__: law for law in (piece_is_film, preview_is_film, every_way_is_the_same, idle_is_said)
}
