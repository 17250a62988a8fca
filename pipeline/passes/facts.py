"""What the passes of a sequence are, and what is known about them, found when the sequence is stored."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Any

from pydantic import JsonValue

from pipeline.passes.find import FoundPass
from pipeline.passes.names import Kind
from pipeline.passes.vectors import VectorFacts

MOTION, MATTES = "motion", "mattes"
_TITLES: Mapping[str, str] = {
    "normals": "normals", "ids": "object ids", "depth": "depth", "position": "positions", "uv": "texture coordinates",
    MATTES: "Cryptomatte",
}  # fmt: skip


def known_vectors(facts: Mapping[str, Any]) -> VectorFacts | None:
    """The convention of the motion vectors in `PassFacts.as_json`; None: the files have no vectors."""
    told = facts.get("vectors")
    if told is None:
        return None
    values = {each.name: told[each.name] for each in fields(VectorFacts) if each.name in told}
    return VectorFacts(**{**values, "factors": tuple(values["factors"])})


@dataclass(frozen=True)
class PassFacts:
    """The passes of a sequence.

    Attributes:
        layer, view: of the picture.
        passes: layer and programs of each kind that was found.
        vectors: what is known about the motion vectors; None: there are none, or only one frame.
        mattes: names of the objects of the Cryptomatte; without a manifest "(no names)".
        layers, views: names of all layers and views of the image.
    """

    layer: str = ""
    view: str = ""
    passes: Mapping[Kind, FoundPass] = field(default_factory=dict)
    vectors: VectorFacts | None = None
    mattes: tuple[str, ...] = ()
    layers: tuple[str, ...] = ()
    views: tuple[str, ...] = ()

    @property
    def kinds(self) -> list[str]:
        """What methods may use: "motion", names of kinds, "mattes"."""
        found = [MOTION] if self.vectors is not None and self.vectors.used else []
        found += [kind for kind in self.passes if kind not in ("vectors", "next", "previous")]
        return found + ([MATTES] if self.mattes else [])

    def as_json(self) -> dict[str, JsonValue]:
        """The facts as JSON, for the asset's info and `impasto inspect`."""
        found: dict[str, JsonValue] = {
            "layer": self.layer, "view": self.view, "kinds": [*self.kinds], "mattes": [*self.mattes],
            "layers": [*self.layers], "views": [*self.views],
            "passes": {
                kind: {"layer": one.layer, "programs": one.programs, "channels": [*one.channels]}
                for kind, one in self.passes.items()
            },
        }  # fmt: skip
        if self.vectors is not None:
            told: dict[str, JsonValue] = {"used": self.vectors.used, "message": self.vectors.sentence()}
            facts: dict[str, Any] = asdict(self.vectors)
            found["vectors"] = {**facts, "factors": [*self.vectors.factors], **told}
        return found


def sentences(facts: Mapping[str, Any], uses: Collection[str]) -> Iterator[str]:
    """Sentences for the user of a job: which passes its method uses.

    Args:
        facts: `PassFacts.as_json` of the video; empty: it has no passes.
        uses: kinds of passes that the method can use.
    """
    if not facts:
        return
    vectors = facts.get("vectors")
    if vectors and MOTION in uses:
        yield str(vectors["message"])
    data = [name for name in facts.get("kinds", ()) if name != MOTION]
    used = [_TITLES[name] for name in data if name in uses]
    left = [_TITLES[name] for name in data if name not in uses]
    if used:
        yield f"The method can use these passes as guides or layers: {', '.join(used)}."
    if left:
        yield (f"The method does not read these passes by itself: {', '.join(left)}. `impasto inspect --extract` makes "
               "masks, label maps and guides of them.")  # fmt: skip
