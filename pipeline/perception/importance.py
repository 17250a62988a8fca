"""The importance map I(p), which determines the amount of detail of each pixel (zhang2011online, section 4.1).

It combines three cues, each in [0, 1] with a weight w: faces F (viola2001rapid), static saliency S (hou2007spectral)
and motion relative to the camera M, by I = 1 - (1 - w_f F)(1 - w_s S)(1 - w_m M). The cues are smoothed over past
frames. A mask by the user overrides the map where it is given.

Departure: the paper uses faces only; it mentions the other cues as an alternative and as future work. It does not
smooth over time. Here I(p) sets the thresholds of edges and of region growing, and a sudden change of it
would show as a sudden change of detail.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import AnyArray, Arrays, State
from pipeline.errors import BadFrame
from pipeline.frames import Flow, Frame, Mask, Plane
from pipeline.perception.face_masks import FaceCrop, face_crops, head_mask, largeness, small_faces
from pipeline.perception.faces import Faces, FaceTracker
from pipeline.perception.flow.warp import warp_back
from pipeline.perception.motion import median_motion
from pipeline.perception.saliency import spectral_residual
from pipeline.perception.shrink import shrink, size_within


@dataclass(frozen=True)
class CueParams:
    """Constants of the cues of importance."""

    map_side_px: int = 96
    """Longer side of the map before it is enlarged to the frame, px; I(p) is smooth enough for this resolution."""
    saliency_side_px: int = 256
    """Longer side of the picture of which saliency is computed, px."""
    cues_every_frames: int = 3
    """Saliency and motion are computed in every third frame, since they are smoothed over a longer time."""
    small_head: float = 0.1
    large_head: float = 0.25
    """Widths of a face, as fractions of the longer side of the frame, between which the weight of its head in
    `small_heads` falls from 1 to 0: strokes are fine enough for a large face."""


CUES = CueParams()


@dataclass(frozen=True)
class ImportanceParams:
    """Parameters of the importance map.

    Attributes:
        face, saliency, motion: weights of the cues, 0..1; a cue with weight 0 is not computed.
        half_life_frames: half-life of the smoothing of the cues, frames; 0 = no smoothing.
        full_motion: speed relative to the camera at which M is about two thirds, frame diagonals per frame.
        large_faces: weight of large faces relative to that of small ones, 0..1.
    """

    face: float = 1.0
    saliency: float = 0.4
    motion: float = 0.4
    half_life_frames: float = 6.0
    full_motion: float = 0.002
    large_faces: float = 1.0


class ImportanceTracker:
    """Computes I(p) for consecutive frames of a video. Causal; not thread-safe. The same frames give the same bytes.

    Args:
        size: (width, height) of the frames, px.
    """

    def __init__(self, params: ImportanceParams, size: tuple[int, int]) -> None:
        self._params = params
        self._size = size
        self._small = size_within(size, CUES.saliency_side_px)
        self.map_size = size_within(size, CUES.map_side_px)
        self._gain = np.float32(
            1.0 - 0.5 ** (CUES.cues_every_frames / params.half_life_frames) if params.half_life_frames > 0 else 1.0
        )
        self._faces = FaceTracker(size, params.half_life_frames)
        self._gray: NDArray[np.uint8] | None = None  # of the frame whose faces are still to be searched
        self._tracked = False  # whether the faces of the coming step are known
        self._age = 0
        self._cues: Plane = np.zeros(self.map_size[::-1], np.float32)
        self._mask: Plane | None = None

    def step(
        self,
        image: Frame | NDArray[np.uint8],
        flow: Flow | None = None,
        cut: bool = False,
        mask: Plane | Mask | None = None,
    ) -> Plane:
        """The importance map of the next frame.

        Args:
            image: the frame, uint8 (height, width, 3) or gray (height, width).
            flow: from the previous frame to this one, px of the frame, on a grid of any size over it; None = unknown,
                treated as no motion.
            cut: whether a shot begins with this frame; the state except the mask is then reset.
            mask: importance given by the user, valid until the next mask: float (height, width) in 0..1, NaN = use the
                cues; or bool. A mask with NaN is a drawing on its frame, and moves along the flow from then on.

        Returns: float32 (height, width) in [0, 1].

        Raises:
            BadFrame: a wrong shape, dtype or range.
        """
        coarse = self.step_coarse(image, flow, cut, mask)
        self.continue_search()
        stretched = np.asarray(cv2.resize(coarse, self._size, interpolation=cv2.INTER_LINEAR), np.float32)
        return np.clip(stretched, 0, 1, out=stretched)

    def step_coarse(
        self,
        image: Frame | NDArray[np.uint8],
        flow: Flow | None = None,
        cut: bool = False,
        mask: Plane | Mask | None = None,
    ) -> Plane:
        """`step` without enlarging the map (`CUES.map_side_px` on its longer side) and without `continue_search`.

        After `track_faces`, `image` may be smaller than the frame.
        """
        if not self._tracked:
            self.track_faces(image, flow, cut)
        self._tracked = False
        moving = None if flow is None or self._age == 0 else _prepare_flow(flow, self.map_size)
        self._mask = self.move_mask(self._mask, mask, moving)
        importance = self._combine(image, moving)
        self._age += 1
        if self._mask is not None:
            importance = importance * (1 - self._mask[..., 1]) + self._mask[..., 0]
        return np.clip(importance, 0, 1)

    def move_mask(self, before: Plane | None, mask: Plane | Mask | None, flow: Flow | None) -> Plane | None:
        """The user's importance in the next frame: float32 at the size of the map, (h, w, 2): importance times weight,
        and weight; None: there is none. Uses no state.

        Args:
            before: the same in the frame before.
            mask, flow: as for `step`.
        """
        if mask is not None:
            return _prepare_mask(mask, self._size, self.map_size)
        if before is None or flow is None or (before[..., 1] >= 1).all():
            return before
        return warp_forward(before, flow, self._size)

    def track_faces(self, image: Frame | NDArray[np.uint8], flow: Flow | None, cut: bool) -> None:
        """Move the faces to the next frame. `step_coarse` does it unless this has been called for the frame.

        Args: `image` of the frame's size, `flow` and `cut` as for `step`.
        """
        _check_shape(image, self._size, "image")
        if cut:
            self._age = 0
        self._tracked = True
        if self._params.face <= 0:
            return
        self._gray = image if image.ndim == 2 else np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), np.uint8)
        moving = None if flow is None or self._age == 0 else _prepare_flow(flow, self.map_size)
        self._faces.step(self._gray, moving, self._age)

    @property
    def faces(self) -> Faces:
        """The faces of the latest frame."""
        return self._faces.faces

    def small_faces(self, picture: tuple[int, int]) -> list[FaceCrop]:
        """Small faces of the latest frame in a picture of (width, height) `picture`, see `face_masks.small_faces`."""
        return small_faces(self._faces.faces, self._size, picture)

    def continue_search(self) -> None:
        """Search a part of the latest frame for faces, for later frames. Call it once after each step."""
        if self._gray is not None:
            self._faces.search(self._gray, self._age - 1)
            self._gray = None

    def small_heads(self) -> Plane | None:
        """Small heads in the latest frame, times the weight of faces; None without a face.

        Returns: float32 at the size of the map, 0..1.
        """
        if not len(self._faces.faces):
            return None
        faces = self._faces.faces.copy()
        widths = faces["box"][:, 2] / max(self._size)
        faces["strength"] *= np.clip((CUES.large_head - widths) / (CUES.large_head - CUES.small_head), 0, 1)
        heads = head_mask(faces, self._size, self._cues.shape)
        return np.asarray(np.float32(self._params.face) * heads, np.float32)

    def eyes_and_mouths(self) -> Plane | None:
        """Brows, eyes, noses and mouths in the latest frame, times the weight of faces; None without a face.

        Returns: float32 at the size of the map, 0..1.
        """
        faces = self._faces.faces
        if not len(faces):
            return None
        found = np.zeros(self._cues.shape, np.float32)
        for face in face_crops(faces, self._size, self.map_size, np.full(len(faces), self._params.face)):
            found[face.box] = np.maximum(found[face.box], face.features())
        return found

    def state(self) -> State:
        """State as arrays by name; a tracker restored from it continues with the same bytes."""
        return {
            "age": np.array(self._age, np.int64),
            "cues": self._cues.copy(),
            "mask": np.empty(0, np.float32) if self._mask is None else self._mask.copy(),
            **self._faces.state(),
        }

    def restore(self, state: Arrays) -> None:
        """Restore a state of a tracker with the same parameters and size."""
        self._age = int(state["age"])
        self._faces.restore(state)
        self._cues = np.array(state["cues"], np.float32)
        mask = np.array(state["mask"], np.float32)
        self._mask = mask if mask.size else None

    def _combine(self, image: NDArray[np.uint8], flow: Flow | None) -> Plane:
        if self._age % CUES.cues_every_frames == 0:
            gain = np.float32(1) if self._age == 0 else self._gain
            small = _shrink_gray(image, self._small)
            self._cues = self._cues + gain * (self._saliency_and_motion(small, flow) - self._cues)
        if self._params.face <= 0 or not len(self._faces.faces):
            return self._cues
        return np.asarray(1 - (1 - self._cues) * (1 - np.float32(self._params.face) * self._heads()), np.float32)

    def _heads(self) -> Plane:
        """The cue F: heads, large ones with their own weight, float32 at the size of the map."""
        faces = self._faces.faces.copy()
        faces["strength"] *= 1 - (1 - self._params.large_faces) * largeness(faces, self._size)
        return head_mask(faces, self._size, self._cues.shape)

    def _saliency_and_motion(self, gray: NDArray[np.uint8], flow: Flow | None) -> Plane:
        """Combined saliency and motion cue of one frame: float32 at the size of the map, 0..1."""
        params = self._params
        remaining = np.ones(self.map_size[::-1], np.float32)
        if params.saliency > 0:
            salient = cv2.resize(spectral_residual(gray), self.map_size, interpolation=cv2.INTER_LINEAR)
            remaining *= 1 - np.float32(params.saliency) * salient
        if params.motion > 0 and flow is not None:
            full_px = params.full_motion * float(np.hypot(*self._size))
            remaining *= 1 - np.float32(params.motion) * _motion(flow, full_px)
        return 1 - remaining


def _motion(flow: Flow, full_px: float) -> Plane:
    """Speed of each pixel relative to the median motion (the camera), mapped to [0, 1)."""
    dominant = median_motion(flow[::2, ::2])
    x, y = flow[..., 0] - dominant[0], flow[..., 1] - dominant[1]
    speed = cv2.GaussianBlur(np.sqrt(x * x + y * y), (0, 0), 2.0)
    # A quarter of the scale is subtracted: parallax of a hand-held camera, and errors of the flow.
    squeezed: Plane = 1 - np.exp(np.minimum(np.float32(0.25) - speed / np.float32(full_px), 0))
    return squeezed


def warp_forward(plane: Plane, flow: Flow, size: tuple[int, int]) -> Plane:
    """A plane of the previous frame, moved along the flow: float32, as `plane`.

    Args:
        plane: float32 (h, w) or (h, w, channels), a grid over the frame.
        flow: from the previous frame to this one, px of the frame, on a grid of any size.
        size: (width, height) of the frame, px.
    """
    height, width = plane.shape[:2]
    coarse = np.asarray(cv2.resize(flow, (width, height), interpolation=cv2.INTER_LINEAR), np.float32)
    cells = np.array([width / size[0], height / size[1]], np.float32)
    return np.asarray(warp_back(plane, -coarse * cells), np.float32)


def _shrink_gray(image: NDArray[np.uint8], size: tuple[int, int]) -> NDArray[np.uint8]:
    """Gray picture of `size`."""
    return shrink(image if image.ndim == 2 else np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), np.uint8), size)


def _prepare_flow(flow: Flow, small: tuple[int, int]) -> Flow:
    return np.asarray(cv2.resize(flow, small, interpolation=cv2.INTER_LINEAR), np.float32)


def _prepare_mask(mask: Plane | Mask, size: tuple[int, int], small: tuple[int, int]) -> Plane:
    """Mask at the size `small`, float32 (h, w, 2): importance times weight, and weight, which is 0 where the mask is
    NaN."""
    _check_shape(mask, size, "mask")
    if mask.dtype != bool and not np.issubdtype(mask.dtype, np.floating):
        remedy = "Divide an 8 bit mask by 255."
        raise BadFrame("A mask must be bool or floating.", field="mask", value=mask.dtype, remedy=remedy)
    values = mask.astype(np.float32)
    given = ~np.isnan(values)
    inside = values[given]
    if inside.size and not (inside.min() >= 0 and inside.max() <= 1):
        found = f"{inside.min():.3g}..{inside.max():.3g}"
        remedy = "Scale it; use NaN for pixels without given importance."
        raise BadFrame("A mask must be in 0..1.", field="mask", value=found, remedy=remedy)
    both = np.dstack([np.where(given, values, 0), given.astype(np.float32)])
    return np.asarray(cv2.resize(both, small, interpolation=cv2.INTER_AREA), np.float32)


def _check_shape(array: AnyArray, size: tuple[int, int], field: str) -> None:
    if array.ndim < 2 or (array.shape[1], array.shape[0]) != size:
        expected = f"(height, width) = ({size[1]}, {size[0]})"
        raise BadFrame(f"The {field} has another size than the video, {expected}.", field=field, value=array.shape)
