"""Exemplars of the style library: scenes of our own, painted by our own methods at the first request."""

from __future__ import annotations

from dataclasses import dataclass, field

from pipeline.errors import BadParameter
from pipeline.frames import Frame
from pipeline.methods import method, parse_params
from pipeline.scenes import scene
from workers.contract.request import Json

SIZE = (960, 640)
"""(width, height), px."""
_FPS = 24.0
_SETTLE = 2
"""Frames after which the temporal filters of a method have settled."""


@dataclass(frozen=True)
class Exemplar:
    """A painting and the picture from which it was painted.

    Attributes:
        name: in addresses, [a-z-].
        at: number of the scene's frame, at 24 frames per second.
    """

    name: str
    title: str
    scene: str
    at: int
    method: str
    params: Json = field(default_factory=dict)

    def source(self) -> Frame:
        """The scene's frame, uint8 (640, 960, 3), RGB."""
        return scene(self.scene, SIZE, self.at + 1, _FPS).image(self.at)

    def painting(self) -> Frame:
        """The source as its method paints it. Raises BadParameter: the method needs more than one frame's past."""
        chosen = method(self.method)
        session = chosen.stream(parse_params(chosen, self.params), SIZE, 0, {})
        if session is None:
            raise BadParameter(f"The method {self.method!r} is not causal.", field="method", value=self.method)
        picture = self.source()
        painted = picture
        for _ in range(_SETTLE):
            painted = session.step(picture)
        return painted


def _strokes(name: str, title: str, place: str, at: int, style: str) -> Exemplar:
    return Exemplar(name, title, place, at, "multistyle", {"style": style})


EXEMPLARS = (
    _strokes("harbour-swirls", "Swirling strokes", "harbour", 20, "van-gogh"),
    _strokes("portrait-dabs", "Broken dabs", "portrait", 20, "impressionism"),
    _strokes("harbour-dots", "Dots", "harbour", 44, "pointillism"),
    _strokes("portrait-bold", "Bold colour", "portrait", 44, "expressionism"),
    _strokes("harbour-wash", "Washes", "harbour", 60, "watercolor"),
    Exemplar("harbour-print", "Colour print", "harbour", 32, "abstraction", {"lines": "flow"}),
)
"""The exemplars, in the order in which they are shown."""
