"""When a parameter or an input has an effect, as data: for forms, documentation, checks of requests, and commands.

A parameter that has none under some conditions lists them in `Params.applies_when`, an input in
`InputSpec.applies_when`: alternatives, of which one must hold. Without a list it always has an effect.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from pydantic import JsonValue

from pipeline.methods.over_time import Keys, largest

Way = Literal["", "film", "piece"]
"""`film`: not in streams, where frames are painted as they arrive (live, pipes); `piece`: only in a piece of a film."""


_PASSES = {"motion": "motion vectors"}
"""Kinds of render passes in words, where they differ."""
_WAYS = {"film": "outside live streams", "piece": "in a piece of a film"}


@dataclass(frozen=True)
class When:
    """Conditions that must all hold.

    Attributes:
        params: parameter -> values of which it must have one.
        above: parameter -> number that its value must exceed, somewhere in the film.
        inputs: names of inputs of which one must be given.
        without: names of inputs of which none may be given.
        without_passes: kinds of render passes (`PassFacts.kinds`) of which the video may have none.
        way: the way in which frames are painted.
    """

    params: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    above: Mapping[str, float] = field(default_factory=dict)
    inputs: tuple[str, ...] = ()
    without: tuple[str, ...] = ()
    way: Way = ""
    without_passes: tuple[str, ...] = ()

    def as_json(self) -> dict[str, JsonValue]:
        """The conditions that there are."""
        return {name: _json(value) for name, value in vars(self).items() if value}

    def in_words(self) -> str:
        """For example "with renderer = explicit and without the input design"."""
        words = [f"with {name} = {' or '.join(values)}" for name, values in self.params.items()]
        words += [f"with {name} above {limit:g}" for name, limit in self.above.items()]
        words += [f"with the input {' or '.join(self.inputs)}"] if self.inputs else []
        words += [f"without the input {' and '.join(self.without)}"] if self.without else []
        passes = " and ".join(_PASSES.get(kind, kind) for kind in self.without_passes)
        words += [f"without {passes} in the video"] if passes else []
        words += [_WAYS[self.way]] if self.way else []
        return " and ".join(words)

    def holds(self, situation: Situation) -> bool:
        """Whether all conditions hold."""
        values, given = situation.params, situation.inputs
        return (
            all(values.get(name) in allowed for name, allowed in self.params.items())
            and all(largest(values.get(name, 0)) > limit for name, limit in self.above.items())
            and (not self.inputs or any(name in given for name in self.inputs))
            and not any(name in given for name in self.without)
            and not any(kind in situation.video_passes for kind in self.without_passes)
            and not (self.way and situation.stream)
            and not (self.way == "piece" and not situation.piece)
        )


def _json(value: Any) -> JsonValue:
    if isinstance(value, Mapping):
        return {name: list(own) if isinstance(own, tuple) else own for name, own in value.items()}
    return list(value) if isinstance(value, tuple) else value


Alternatives = tuple[When, ...]


@dataclass(frozen=True)
class Situation:
    """Parameters, inputs and way of painting of a job or a live session.

    Attributes:
        params: every parameter with its value.
        inputs: names of the inputs that are given.
        stream: whether frames are painted as they arrive.
        piece: whether a piece of a film is painted.
        video_passes: kinds of render passes that the video has.
    """

    params: Mapping[str, Any]
    inputs: Collection[str]
    stream: bool = False
    piece: bool = False
    video_passes: Collection[str] = ()


@dataclass(frozen=True)
class Ineffective:
    """A given parameter or input without effect.

    Attributes:
        field: "params.NAME" or "inputs.NAME".
        value: the parameter's value; "" for an input.
    """

    field: str
    value: Any
    message: str
    remedy: str


def in_words(alternatives: Alternatives) -> str:
    """The alternatives in words, for documentation and messages."""
    return "; or ".join(when.in_words() for when in alternatives)


def ineffective(
    params: Mapping[str, Alternatives], defaults: Mapping[str, Any], inputs: Mapping[str, Alternatives],
    situation: Situation,
) -> Iterator[Ineffective]:  # fmt: skip
    """Parameters that differ from their defaults, and given inputs, that have no effect in a situation.

    Args:
        params, inputs: conditions by name.
    """
    for name, alternatives in params.items():
        value = situation.params.get(name)
        if value != defaults.get(name) and not any(when.holds(situation) for when in alternatives):
            yield _found(f"params.{name}", value, f"{name} = {value}", alternatives)
    for name, value in situation.params.items():
        if situation.stream and isinstance(value, Keys):
            message = f"{name} has values over time, by the frames of a film; a live stream has no such frames."
            yield Ineffective(f"params.{name}", value, message, f"Give one number for {name}.")
    for name, alternatives in inputs.items():
        if alternatives and name in situation.inputs and not any(when.holds(situation) for when in alternatives):
            yield _found(f"inputs.{name}", "", f"The input {name!r}", alternatives)


def unmade(
    conditions: Mapping[str, Alternatives], names: Collection[str], situation: Situation, field: str
) -> Iterator[Ineffective]:
    """Requested artefacts or passes that cannot be made.

    Args:
        conditions: by name.
        field: "output.artefacts" or "output.passes".
    """
    for name in names:
        if name in conditions and not any(when.holds(situation) for when in conditions[name]):
            what = f"The {'pass' if field.endswith('passes') else 'artefact'} {name!r}"
            yield _found(f"{field}.{name}", name, what, conditions[name])


def _found(field: str, value: Any, what: str, alternatives: Alternatives) -> Ineffective:
    name = field.rpartition(".")[2]
    remedy = f"Leave {name} out, or use it {in_words(alternatives)}."
    return Ineffective(field, value, f"{what} has no effect here: it applies only {in_words(alternatives)}.", remedy)
