"""Exemplars of the style library: scenes of our own, painted by our own methods at the first request."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

from pipeline.errors import BadParameter
from pipeline.frames import Frame
from pipeline.method_names import BUILT_IN
from pipeline.methods import method, parse_params
from pipeline.methods.base import Exemplar, Method
from pipeline.scenes import scene

SIZE = (960, 640)
"""(width, height), px."""
_FPS = 24.0
_SETTLE = 2
"""Frames after which the temporal filters of a method have settled."""


@dataclass(frozen=True)
class Painting:
    """An exemplar with the method that paints it."""

    method: Method
    exemplar: Exemplar

    def source(self) -> Frame:
        """The scene's frame, uint8 (640, 960, 3), RGB."""
        one = self.exemplar
        return scene(one.scene, SIZE, one.at + 1, _FPS).image(one.at)

    def painting(self) -> Frame:
        """The source as the method paints it. Raises BadParameter: the method needs more than one frame's past."""
        session = self.method.stream(parse_params(self.method, self.exemplar.params), SIZE, 0, {})
        if session is None:
            name = self.method.name
            raise BadParameter(f"The method {name!r} is not causal.", field="method", value=name)
        picture = self.source()
        painted = picture
        for _ in range(_SETTLE):
            painted = session.step(picture)
        return painted


@cache
def exemplars() -> Mapping[str, Painting]:
    """Exemplars of the built-in methods by name, in the order in which they are shown."""
    own = [method(name) for name in BUILT_IN]
    return {one.name: Painting(chosen, one) for chosen in own for one in chosen.exemplars}
