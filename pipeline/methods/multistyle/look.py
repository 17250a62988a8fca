"""The eye: motion, directions, detail, and the life of every stroke. What has a memory is here; painting has none."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.flow import estimate
from pipeline.flow.reliability import inside
from pipeline.flow.turn import turn
from pipeline.flow.warp import fetch
from pipeline.frames import Flow, Frame, Mask, Plane, same_size
from pipeline.methods.abstraction.state import Clock, State, flatten, part
from pipeline.methods.multistyle.design import Design
from pipeline.methods.multistyle.designer import Designer, Placed
from pipeline.methods.multistyle.drying import Drying
from pipeline.methods.multistyle.fields import SMALLEST_PX, StyleFields, chosen_style, style_fields, uniform
from pipeline.methods.multistyle.held import hold, hold_field, rest
from pipeline.methods.multistyle.params import MultistyleParams
from pipeline.methods.multistyle.sight import COLUMNS, Marks, Sight
from pipeline.methods.multistyle.styles import STYLES, pigment
from pipeline.segmentation.cuts import is_cut, thumbnail
from pipeline.segmentation.importance import ImportanceParams, ImportanceTracker
from pipeline.strokes.brush import Brush, tint
from pipeline.strokes.carry import Habits, Living, begin, carry, tend
from pipeline.strokes.layers import area_error, layer_brush, layer_threshold, spacing_px, typical
from pipeline.strokes.random import Purpose, draws
from pipeline.strokes.seeds import Seeds, place, sample
from pipeline.tensors.edges import edge_field, gradient_tensor, remember
from pipeline.tensors.field import Field as Tensors2
from pipeline.tensors.field import field_of

LARGE_ROWS = 400
"""From so many rows on, the picture is worked from at half its size: strokes are wider than what is lost."""
LEAST_COLUMNS = 64
"""But not of a strip: motion is not found in less than 16 px."""
WISH_HOLD, WISH_FOLLOW = 0.06, 0.25
"""Wished detail that changes by less stays as it is; more is gone after by so much a frame."""
EDGE_SHRINKS, STRICTER = 0.85, 0.5
"""Each finer layer keeps to its colour this much more strictly; and how much more where detail is fullest, in parts."""
GAP = 0.6
"""A new stroke comes where no other is nearer than this, in spacings."""
LEAST_BREAK = 45.0
"""Change of colour, RGB distance, that no stroke is lifted for."""
DIRECTION_HOLD = 0.2
"""Change of (cos 2a, sin 2a) up to which a direction stays as it was: 6 degrees."""
FACES_EVERY, FACES_KEPT, FACES_SIDE_PX = 12, 60, 400
"""Faces are looked for more often and in a larger picture than a cartoon's: a lost face is the first thing seen."""
LEAST_BLUR = 0.3
"""Sigma, px, below which a picture is not blurred at all."""
COARSE_ROWS = 160
"""Directions are found at about this many rows: strokes are wider than what is lost."""
BACK_ROWS = 160
"""The way back that paint lingers along is kept at about this many rows."""
BROAD = 6.0
"""Where the picture runs nowhere by itself, it runs as its surroundings do: sigma of these, in those of the edges."""
BROADLY, BY_DEFAULT = 0.15, 0.012
"""Weights of the surroundings' direction and of the default one, beside a clear edge's 1."""
DETAIL_MEMORY = 0.8
"""Weight of the past, along the motion, in what finer layers are to add; nothing where something else has come."""
HOLD = 0.6
"""A finer stroke that is there stays down to this part of the error threshold."""


class Eye:
    """Looks at frame after frame of one size. Not thread-safe.

    Args:
        params: the method's.
        size: (width, height), px.
        seed: of all random numbers.
        clock: called with a stage's name, times it.
        design: what is wanted of which region; None = one style for all.
    """

    def __init__(
        self, params: MultistyleParams, size: tuple[int, int], seed: int, clock: Clock, design: Design | None = None
    ) -> None:  # fmt: skip
        params = params.eased
        self.params, self.size, self.seed, self.clock = params, size, seed, clock
        self.manner = STYLES[params.style].manner
        self.habits = Habits(gap=GAP, fade=params.stroke_fade, follow=params.colour_follow)
        self.factor = max(1, round(size[1] / COARSE_ROWS))
        self.small = (max(1, size[0] // self.factor), max(1, size[1] // self.factor))
        self.style = chosen_style(params)
        self.designer = None if design is None else Designer(design, self.style, size, self.small)
        by = 2 if size[1] >= LARGE_ROWS and size[0] >= LEAST_COLUMNS else 1
        self.work = (size[0] // by, size[1] // by)
        self.importance = ImportanceTracker(_importance(params), size)
        self.age = 0
        self.gray: NDArray[np.uint8] | None = None
        self.thumbnail: Plane | None = None
        self.tensors: NDArray[np.float32] | None = None
        self.field: Tensors2 | None = None
        self.other: Mask | None = None
        self.held: NDArray[np.float32] | None = None
        self.wish: Plane | None = None
        self.wished: Plane | None = None
        self.drying = Drying(bool(self.manner.paper))
        self.errors: list[Plane] = []
        self.living: list[Living] = []

    def step(self, frame: Frame, placed: Placed | None = None) -> Sight:
        """The next frame.

        Args:
            frame: uint8 (h, w, 3).
            placed: where the regions of the design are in it; None: there is no design.
        """
        frame = same_size(frame, self.size)
        fresh = self._begins_shot(frame)
        gray = np.asarray(cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY), np.uint8)
        flow, back = self._flow(gray, fresh)
        picture = self._hold(frame, back)
        detail = self._detail(gray, flow, fresh)
        field = self._directions(picture, back, placed)
        with self.clock("style"):
            values = uniform(self.style) if placed is None or self.designer is None else self.designer.values(placed)
            fields = style_fields(values, detail, self.size[1])
        with self.clock("strokes"):
            layers = self._strokes(picture, fields, flow, back)
        self.gray, self.age = gray, self.age + 1
        field16 = np.ascontiguousarray(field.transpose(1, 2, 0), np.float16)
        way = None if back is None else _coarser(back)
        rims = self.drying.step(picture, back, self.other)
        return Sight(self.age, picture, field16, layers, way, rims)

    def _begins_shot(self, frame: Frame) -> bool:
        before, self.thumbnail = self.thumbnail, thumbnail(frame)
        if before is None or self.params.temporal == "off":
            return True
        return is_cut(before, self.thumbnail, self.params.cut_sensitivity)

    def _flow(self, gray: NDArray[np.uint8], fresh: bool) -> tuple[Flow | None, Flow | None]:
        """From the last frame to this one at the frame's size, for strokes; and back, at the working size."""
        if fresh or self.gray is None:
            return None, None
        with self.clock("flow"):
            before, now = (_shrunk(plane, self.work) for plane in (self.gray, gray))
            back = rest(estimate(now, before, self.params.flow), now, before, self.params.stillness)
            flow, _ = turn(back, now, before)
            return _enlarged(flow, self.size), back

    def _hold(self, frame: Frame, back: Flow | None) -> Frame:
        """The held picture, uint8 at the working size."""
        with self.clock("hold"):
            now = _shrunk(frame, self.work).astype(np.float32)
            if back is not None and self.held is not None:
                held, self.other = hold(now, self.held, back, self.params.hold * self.manner.hold)
                now = held if self.params.hold else now
            self.held = now
            return np.asarray(np.rint(now), np.uint8)

    def _detail(self, gray: NDArray[np.uint8], flow: Flow | None, fresh: bool) -> Plane | None:
        """How much finer than the style to paint, float32 (h, w); None = nowhere."""
        params = self.params
        if max(params.face_detail, params.saliency_detail, params.motion_detail) <= 0:
            return None
        with self.clock("detail"):
            coarse = self.importance.step_coarse(gray, flow, fresh)
            self.importance.search_on()
            if not fresh and self.wish is not None:
                apart = np.abs(coarse - self.wish)
                coarse = self.wish + np.where(apart > WISH_HOLD, np.float32(WISH_FOLLOW), 0) * (coarse - self.wish)
            self.wish = np.asarray(coarse, np.float32)
            self.wished = np.asarray(cv2.resize(self.wish, self.size, interpolation=cv2.INTER_LINEAR), np.float32)
            return self.wished

    def _directions(self, picture: Frame, back: Flow | None, placed: Placed | None) -> Tensors2:
        """The edge field, float32 (2, h', w'), smoothed over space and time, with a direction everywhere."""
        with self.clock("directions"):
            small = _shrunk(np.asarray(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY), np.uint8), self.small)
            sigma = max(self.params.edge_smoothing * self.small[1] / 1000, 0.8)
            now = gradient_tensor(small.astype(np.float32), sigma)
            way = None if back is None else _resized(back, self.small)
            if way is not None and self.tensors is not None:
                known = None if self.other is None else _known(self.other, self.small)
                now = remember(now, self.tensors, way, known, self.params.edge_memory)
            self.tensors = now
            near = edge_field(now)
            wide = np.stack([_blurred(plane, sigma * BROAD) for plane in near])
            default = field_of(math.radians(self.params.default_angle), BY_DEFAULT)[:, None, None]
            field = np.asarray(near + np.float32(BROADLY) * wide + default, np.float32)
            field = _unit(field)
            if way is not None and self.field is not None:
                field = hold_field(field, self.field, way, DIRECTION_HOLD)
            self.field = field
            if placed is None or self.designer is None:
                return field
            return _unit(self.designer.directions(field, placed))

    def _strokes(
        self, picture: Frame, fields: StyleFields, flow: Flow | None, before: Flow | None
    ) -> tuple[Marks, ...]:  # fmt: skip
        if flow is None:
            self.living, self.errors = [], []
        brushes = [layer_brush(fields.brush, self.manner.recipe, k) for k in range(self._count(fields))]
        scale = self.work[1] / self.size[1]
        out, marks, below = [], [], picture
        revealed = None if flow is None else self._revealed(flow)
        for index, brush in enumerate(brushes):
            width = typical(brush.size_px) * scale
            sigma = self.manner.recipe.blur * width / 2
            reference = _stretched(_blurred(picture, sigma) if sigma > LEAST_BLUR else picture, self.size)
            living = self._layer(index, brush, reference, fields, flow, picture, below, before, revealed)
            out.append(living)
            marks.append(self._marks(living, brush, sigma if sigma > LEAST_BLUR else 0.0, index))
            below = np.asarray(_blurred(picture, max(width / 2, 0.5)), np.uint8)
        self.living = out
        return tuple(marks)

    def _count(self, fields: StyleFields) -> int:
        """Layers that any pixel has, as far as their strokes are wide enough to be seen."""
        recipe, most = self.manner.recipe, round(float(np.max(fields.layers)) + 1e-6)
        fit = int(math.log(max(fields.widest_px / SMALLEST_PX, 1)) / -math.log(recipe.ratio))
        return max(1, min(most, recipe.most, 1 + fit))

    def _layer(
        self, index: int, brush: Brush, reference: Frame, fields: StyleFields, flow: Flow | None, picture: Frame,
        below: Frame, before: Flow | None, revealed: Mask | None,
    ) -> Living:  # fmt: skip
        spacing, recipe = spacing_px(brush, self.manner.recipe), self.manner.recipe
        candidates = place(
            self.size[::-1], spacing, jitter=recipe.scatter, seed=self.seed, layer=index,
            birth=0 if self.params.temporal == "off" else self.age,
        )  # fmt: skip
        limit = None
        if index:
            error = self._error(index, picture, below, before)
            threshold = layer_threshold(fields.layers, fields.threshold, index, self.size[::-1])
            candidates = candidates[self._missing(candidates, error, brush, threshold, 1.0)]
            limit = error, threshold
        if flow is None or len(self.living) <= index:
            return begin(candidates, reference, spacing, self.habits)
        living = carry(self.living[index], flow)
        keep = None if limit is None else self._missing(living.seeds, limit[0], brush, limit[1], HOLD)
        habits = replace(self.habits, break_off=max(recipe.edge * EDGE_SHRINKS**index, LEAST_BREAK))
        return tend(living, candidates, reference, spacing, habits=habits, wanted=keep, revealed=revealed)

    def _revealed(self, flow: Flow) -> Mask:
        """What has come into the picture, or into view, bool (h, w): strokes come up at once there."""
        outside = ~inside(-flow)
        if self.other is None:
            return outside
        return outside | (_stretched(self.other.astype(np.uint8), self.size) > 0)

    def _missing(self, seeds: Seeds, error: Plane, brush: Brush, threshold: Plane, hold: float) -> NDArray[np.bool_]:
        """Which strokes the picture needs: their area error exceeds `hold` times the threshold."""
        scale = np.float32(self.work[1] / self.size[1])
        side = sample(np.asarray(brush.size_px, np.float32), seeds.xy) * scale
        found = area_error(error, seeds.xy * scale, side)
        return np.asarray(found > sample(threshold, seeds.xy) * np.float32(hold), np.bool_)

    def _error(self, index: int, picture: Frame, below: Frame, before: Flow | None) -> Plane:
        """How far the picture is from what the layer below can show of it, RGB distance, at half the size.

        Departure: hertzmann1998painterly compares with the canvas. Here it is what strokes of that size leave out, a
        blurred picture: it does not depend on where single strokes lie, so it does not flicker with them, and a frame
        can be painted by itself.
        """
        apart = picture.astype(np.float32) - below.astype(np.float32)
        red, green, blue = cv2.split(apart)  # by plane: a sum over three channels is slow
        now = np.sqrt(red * red + green * green + blue * blue)
        if before is not None and len(self.errors) >= index:
            past = fetch(self.errors[index - 1], before)
            share = np.float32(DETAIL_MEMORY) if self.other is None else np.float32(DETAIL_MEMORY) * ~self.other
            now = now + share * (past - now)
        now = np.asarray(now, np.float32)
        self.errors = [*self.errors[: index - 1], now, *self.errors[index:]]
        return now

    def _marks(self, living: Living, brush: Brush, sigma_px: float, index: int) -> Marks:
        """The layer's strokes, with their paint."""
        seeds, manner = living.seeds, self.manner
        table = np.zeros((len(living), COLUMNS), np.float16)
        table[:, 0:3] = np.clip(
            tint(pigment(living.aims, manner.vivid, manner.contrast), seeds, brush, self.seed), 0, 255
        )
        table[:, 3:6] = living.aims
        for column, field in enumerate(
            (np.divide(brush.size_px, 2), brush.opacity, brush.relief_px, brush.grain, brush.length_px), 6
        ):
            table[:, column] = sample(np.asarray(field, np.float32), seeds.xy)
        table[:, 11] = living.presence
        stray = draws(seeds.ids, self.seed, Purpose.ORDER)[:, 1] - np.float32(0.5)
        table[:, 12] = np.sqrt((living.born * living.born).sum(axis=1)) + np.float32(manner.mingle) * stray
        strict = 0.0 if self.wished is None else sample(self.wished, seeds.xy) * np.float32(STRICTER)
        table[:, 13] = manner.recipe.edge * EDGE_SHRINKS**index * (1 - strict)
        return Marks(seeds.xy, seeds.ids, table, sigma_px)

    def state(self) -> State:
        """All it remembers; an eye restored from it goes on with the same bytes."""
        own: State = {"age": np.array(self.age)}
        memories = {
            "gray": self.gray,
            "thumbnail": self.thumbnail,
            "tensors": self.tensors,
            "held": self.held,
            "field": self.field,
        }
        own |= {name: array for name, array in (memories | {"wish": self.wish}).items() if array is not None}
        layers = {f"living{k}": _living_state(living) for k, living in enumerate(self.living)}
        errors = {"errors": {str(k): error for k, error in enumerate(self.errors)}}
        return own | flatten({"importance": self.importance.state(), "drying": self.drying.state()} | layers | errors)

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        self.age = int(state["age"])
        self.gray, self.thumbnail, self.tensors = (state.get(name) for name in ("gray", "thumbnail", "tensors"))
        self.held, self.wish, self.field = state.get("held"), state.get("wish"), state.get("field")
        self.drying.restore(part(state, "drying"))
        self.importance.restore(part(state, "importance"))
        errors = part(state, "errors")
        self.errors = [errors[str(k)] for k in range(len(errors))]
        count = sum(name.startswith("living") and name.endswith(".xy") for name in state)
        self.living = [_living_from(part(state, f"living{k}")) for k in range(count)]


def _living_state(living: Living) -> State:
    return {
        "xy": living.seeds.xy, "ids": living.seeds.ids, "aims": living.aims, "presence": living.presence,
        "leaving": living.leaving, "born": living.born,
    }  # fmt: skip


def _living_from(state: Mapping[str, NDArray[Any]]) -> Living:
    seeds = Seeds(state["xy"], state["ids"])
    return Living(seeds, state["aims"], state["presence"], state["leaving"], state["born"])


def _unit(field: Tensors2) -> Tensors2:
    return np.asarray(field / (np.sqrt(field[0] * field[0] + field[1] * field[1]) + np.float32(1e-3)), np.float32)


def _shrunk(image: NDArray[np.uint8], size: tuple[int, int]) -> NDArray[np.uint8]:
    if (image.shape[1], image.shape[0]) == size:
        return image
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)


def _stretched(image: NDArray[np.uint8], size: tuple[int, int]) -> NDArray[np.uint8]:
    if (image.shape[1], image.shape[0]) == size:
        return image
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_LINEAR), np.uint8)


def _resized(flow: Flow, size: tuple[int, int]) -> Flow:
    """The flow of a smaller picture, in its px."""
    scale = np.float32(size[1] / flow.shape[0])
    return np.asarray(cv2.resize(flow, size, interpolation=cv2.INTER_AREA) * scale, np.float32)


def _enlarged(flow: Flow, size: tuple[int, int]) -> Flow:
    if (flow.shape[1], flow.shape[0]) == size:
        return flow
    scale = np.array([size[0] / flow.shape[1], size[1] / flow.shape[0]], np.float32)
    return np.asarray(cv2.resize(flow, size, interpolation=cv2.INTER_LINEAR) * scale, np.float32)


def _known(other: Mask, size: tuple[int, int]) -> Plane:
    """Where the past still tells something, float32, coarser: 0 where something else has come."""
    return np.asarray(1 - cv2.resize(other.astype(np.float32), size, interpolation=cv2.INTER_AREA), np.float32)


def _coarser(back: Flow) -> NDArray[np.float16]:
    """For what lingers: a way back is smooth, and this is kept for every frame."""
    by = max(1, back.shape[0] // BACK_ROWS)
    size = (max(1, back.shape[1] // by), max(1, back.shape[0] // by))
    return np.asarray(cv2.resize(back, size, interpolation=cv2.INTER_AREA), np.float16)


def _blurred(image: NDArray[Any], sigma_px: float) -> NDArray[Any]:
    return np.asarray(cv2.GaussianBlur(image, (0, 0), sigma_px))


def _importance(params: MultistyleParams) -> ImportanceParams:
    return ImportanceParams(
        face=params.face_detail, saliency=params.saliency_detail, motion=params.motion_detail,
        detect_every_frames=FACES_EVERY, keep_frames=FACES_KEPT, detection_side_px=FACES_SIDE_PX,
    )  # fmt: skip
