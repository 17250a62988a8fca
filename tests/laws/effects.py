"""Law 4: every parameter and every input that is given has an effect where `applies_when` says so."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import Any

from pipeline.errors import BadInput
from pipeline.methods import method, methods
from tests.laws import ways
from tests.laws.cases import Case, extremes, generated, meeting, properties_of
from tests.laws.ways import difference

NEEDS_MORE = {
    ("abstraction", "face_importance"): "needs a face",
    ("multistyle", "face_detail"): "needs a face",
    ("patches", "face_detail"): "needs a face",
    ("patches", "background_patches"): "needs a second plane of the background",
    ("abstraction", "analysis"): "needs 720 rows",
    ("analogy", "refinement"): "needs frames of 720 rows",
    ("analogy", "key_transparency"): "needs a key with semi-transparent paint",
    ("analogy", "vectors"): "needs a shot with motion vectors",
    ("analogy", "guided_stills"): "needs one frame with a registered style",
}
"""Parameters that small synthetic films cannot show, with what they need; other tests paint them."""
_LOOKS = ((1, 1.0), (1, 1.0), (2, 0.3), (4, 1.0))
"""Size and brightness of the films that are tried one after another."""
_KEPT = 8
"""Films without a change that are kept."""
REQUIRED = 255.0
"""Effect of an input without which another one is refused."""


def parameters() -> Iterator[tuple[str, str]]:
    """(method, parameter) of every parameter but those of `NEEDS_MORE`."""
    for name, chosen in methods().items():
        yield from ((name, one) for one in properties_of(chosen) if (name, one) not in NEEDS_MORE)


def inputs() -> Iterator[tuple[str, str]]:
    """(method, input) of every optional input."""
    for name, chosen in methods().items():
        yield from ((name, spec.name) for spec in chosen.inputs[1:] if not spec.required)


Paint = Callable[[Case], ways.Frames]


class Unchanged:
    """Films without a change: many parameters are compared with the same one. Keeps the last few."""

    def __init__(self) -> None:
        self._painted: dict[str, ways.Frames] = {}

    def __call__(self, case: Case, paint: Paint) -> ways.Frames:
        if (name := f"{paint.__name__} {case}") not in self._painted:
            self._painted = dict(list(self._painted.items())[-_KEPT:]) | {name: paint(case)}
        return self._painted[name]


def effect_of_parameter(name: str, parameter: str, unchanged: Unchanged, tries: int = len(_LOOKS)) -> float:
    """Mean change of the picture by a parameter where its conditions hold, gray levels; 0: no try has shown any."""
    chosen, alternatives = method(name), method(name).Params.applies_when.get(parameter, ())
    is_piece = any(when.way == "piece" for when in alternatives)
    paint = ways.piece if is_piece else ways.film
    for seed in range(tries):
        case = _plain(name, seed)
        for number in range(max(1, len(alternatives))):
            situation = meeting(case, alternatives[number : number + 1])
            if (found := _most(situation, parameter, properties_of(chosen)[parameter], paint, unchanged)) > 0:
                return found
    return 0.0


def _most(case: Case, parameter: str, schema: Mapping[str, Any], paint: Paint, unchanged: Unchanged) -> float:
    before = unchanged(case, paint)
    changes = (
        difference(before, paint(case.with_params(**{parameter: value}))) for value in extremes(schema, parameter)
    )
    return next((change for change in changes if change > 0), 0.0)


def effect_of_input(name: str, given: str, tries: int = len(_LOOKS)) -> float:
    """Mean change of the picture by an input where its conditions hold, gray levels; `REQUIRED` if another input needs
    it."""
    chosen = method(name)
    (spec,) = [one for one in chosen.inputs if one.name == given]
    for seed in range(tries):
        case = meeting(_plain(name, seed), spec.applies_when)
        needed = tuple(one for one in (*case.inputs, spec.needs) if one and one != given)
        without = replace(case, inputs=tuple(one.name for one in chosen.inputs if one.name in needed))
        with_it = without.with_inputs(given)
        after = ways.film(with_it)
        try:
            before = ways.film(without)
        except BadInput:
            return REQUIRED
        if (found := difference(before, after)) > 0:
            return found
    return 0.0


def _plain(name: str, seed: int) -> Case:
    """A case of defaults with the required inputs only; every second one has a cut."""
    case = generated(seed, name)
    required = tuple(spec.name for spec in method(name).inputs[1:] if spec.required)
    scale, light = _LOOKS[seed % len(_LOOKS)]
    frames = 24 if seed == len(_LOOKS) - 2 else 6
    film = {"frames": frames, "cut": 4 * (seed % 2), "piece": (3, 5), "scale": scale, "light": light}
    return replace(case, params={}, inputs=required, **film)
