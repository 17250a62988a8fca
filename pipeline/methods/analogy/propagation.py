"""Interactive propagation: repaints the neighbours of an edited keyframe within a fraction of a second.

The full method (`keyframe_synthesizer`) runs four levels and two sweeps over an interval. Here a keyframe is advected
along the optical flow, frame by frame, and each frame gets one round of PatchMatch at the full size of the proxy, which
suffices to show the effect of an edit. Motion, guides and earlier results are cached between edits; after a local edit
only pixels that show the edited part are searched again.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator, Sequence
from typing import Any, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.compute import device
from pipeline.frames import Frame
from pipeline.methods.analogy.inputs import OPAQUE
from pipeline.methods.analogy.params import AnalogyParams
from pipeline.methods.analogy.style_images import energy_of, patch_colours
from pipeline.perception.flow import estimate
from pipeline.perception.flow.gray import to_gray
from pipeline.synthesis.images import NOWHERE, Bytes, Offsets, StyleImage, Target, packed
from pipeline.synthesis.motion import Motion, motions_between, zero_still_velocity
from pipeline.synthesis.opencl import OpenCLOperations
from pipeline.synthesis.operations import FrameState
from pipeline.synthesis.refine import colours
from pipeline.synthesis.sweeps import SearchSchedule, Sweep, order
from pipeline.synthesis.tone_matching import lab_guide

SEARCH_PX = 4.0
"""Radius of the random search, px."""
MAX_CACHED_FRAMES = 24
"""Frames whose motion, guides and results are cached: 4 MB each at 480x270. More only if one call needs more."""
V = TypeVar("V")


class Propagator:
    """Propagates keyframes of one shot to their neighbours. Not thread-safe; deterministic.

    Args:
        frames: all frames of the shot at proxy size, uint8 (h, w, 3); 480x270 is intended. They are not cached.
        params: parameters of the method; those of the groups Keyframes, Search (patch) and Time apply.
        seed: random seed of the job.
    """

    def __init__(self, frames: Sequence[Frame], params: AnalogyParams | None = None, seed: int = 0) -> None:
        self.params = params or AnalogyParams()
        self._frames, self._seed = frames, seed
        self._ops = OpenCLOperations(device())
        self._energy = energy_of(self.params, (), 0, keyframe_style=True)
        self._guides: OrderedDict[int, Bytes] = OrderedDict()
        self._motions: OrderedDict[int, tuple[Motion, Motion]] = OrderedDict()
        self._results: OrderedDict[tuple[int, int], tuple[Frame, Offsets]] = OrderedDict()

    @property
    def size_bytes(self) -> int:
        """Memory of guides, motion, results and the paintings of the results, bytes."""
        paintings = {id(painting): painting.nbytes for painting, _ in self._results.values()}
        motions = [motion for both in self._motions.values() for motion in both]
        return (
            sum(guide.nbytes for guide in self._guides.values())
            + sum(motion.displacement.nbytes + motion.visible.nbytes for motion in motions)
            + sum(offsets.nbytes for _, offsets in self._results.values())
            + sum(paintings.values())
        )

    def prepare(self, key: int, around: int = 2) -> None:
        """Compute motion and guides near a keyframe in advance, for example when the user opens it.

        Args:
            key: frame number of the keyframe.
            around: number of frames on each side.
        """
        near = self._near(key, around)
        self._evict(max(MAX_CACHED_FRAMES, len(near)))
        for index in near:
            self.guide(index)
            if index + 1 in near:
                self.motion(index, index + 1)

    def repaint(self, key: int, image: NDArray[np.uint8], around: int = 2) -> Iterator[tuple[int, Frame]]:
        """The keyframe and its neighbours, (frame number, uint8 (h, w, 3)): nearest first, the keyframe before all.

        Args:
            key: frame number of the keyframe.
            image: its painting, uint8 (h, w, 3) or, with opacity, (h, w, 4), of the frames' size. Transparent pixels
                are filled with the last painting that another keyframe has propagated there, else with the frame.
                Every output colour is one of the colours of the filled painting.
            around: number of frames on each side.

        Raises:
            ValueError: the painting does not have the size of the frames.
        """
        if image.shape[:2] != self._frames[key].shape[:2]:
            raise ValueError(f"The keyframe is {image.shape}, the frames are {self._frames[key].shape}.")
        near = self._near(key, around)
        self._evict(max(MAX_CACHED_FRAMES, len(near)))
        painting = self._filled(key, image)
        style = StyleImage(
            painting, packed(self._energy, patch_colours(painting, self.params.colours), self.guide(key))
        )
        loaded = self._ops.load(style, self._energy)
        directions = [
            self._propagate(key, loaded, order(key, near.stop, True)),
            self._propagate(key, loaded, order(near.start, key + 1, False)),
        ]
        yield key, painting
        for _ in range(around):
            for frames in directions:
                if (solved := next(frames, None)) is not None:
                    yield solved[0], np.ascontiguousarray(colours(style, solved[1])[..., :3])

    def _near(self, key: int, around: int) -> range:
        return range(max(0, key - around), min(len(self._frames), key + around + 1))

    def _evict(self, most: int) -> None:
        """Drop the least recently used entries, so that at most `most` guides, motions and results remain."""
        for cache in (self._guides, self._motions, self._results):
            while len(cache) > most:
                cache.popitem(last=False)

    def _filled(self, key: int, image: NDArray[np.uint8]) -> Frame:
        """A copy of the painting whose transparent pixels are filled."""
        if image.shape[2] == 3:
            return image.copy()
        painted = image[..., 3:] >= OPAQUE
        return np.ascontiguousarray(np.where(painted, image[..., :3], self._background(key)))

    def _background(self, index: int) -> Frame:
        """The last painting of a frame that another keyframe has propagated; without one, the frame itself."""
        for (key, other), (painting, offsets) in reversed(self._results.items()):
            if other == index and key != index:
                return colours(StyleImage(painting, painting), offsets)
        return self._frames[index]

    def _propagate(self, key: int, style: Any, frames: range) -> Iterator[tuple[int, Offsets]]:
        """Frames in order, away from the key, with their offsets."""
        painting: Frame = style.style.colours
        animation = _Neighbourhood(self, key, painting)
        schedule = SearchSchedule(1, SEARCH_PX, self._seed & 0xFFFFFFFF, key & 0xFFF)
        sweep = Sweep(self._ops, style, animation, animation.previous, schedule, forward=True)
        for solved in sweep.run(frames):
            if solved.index == key:
                continue
            offsets: Offsets = self._ops.fetch(solved.offsets)
            self._results[key, solved.index] = painting, offsets
            self._results.move_to_end((key, solved.index))
            yield solved.index, offsets

    def changed(self, before: Frame, after: Frame) -> Bytes:
        """Pixels whose patches differ between two paintings of a keyframe, uint8 (h, w), 1 = changed."""
        changed = (before != after).any(-1).astype(np.uint8)
        reach = 2 * (self.params.patch_radius + int(SEARCH_PX)) + 1
        return np.asarray(cv2.dilate(changed, np.ones((reach, reach), np.uint8)), np.uint8)

    def guide(self, index: int) -> Bytes:
        """CIELAB guide of a frame."""
        if index not in self._guides:
            self._guides[index] = lab_guide(self._frames[index])
        return _touch(self._guides, index)

    def motion(self, index: int, other: int) -> Motion:
        """Motion from frame `index` to its neighbour `other`."""
        first = min(index, other)
        if first not in self._motions:
            a, b = (to_gray(self._frames[k]) for k in (first, first + 1))
            plus = zero_still_velocity(estimate(a, b, self.params.flow), a, b)
            minus = zero_still_velocity(-estimate(b, a, self.params.flow), b, a)
            self._motions[first] = motions_between(plus, minus, self.params.occlusion_epsilon, (a, b))
        return _touch(self._motions, first)[0 if index < other else 1]

    def upload(self, offsets: Offsets) -> Any:
        """Copy offsets to the device."""
        return self._ops.upload(offsets)

    def result(self, key: int, index: int) -> tuple[Frame, Offsets] | None:
        """The painting and the offsets of the last call that reached a frame from the keyframe."""
        return self._results.get((key, index))


def _touch(cache: OrderedDict[int, V], index: int) -> V:
    """Return an entry and mark it as the most recently used one."""
    cache.move_to_end(index)
    return cache[index]


class _Neighbourhood:
    """The `sweeps.Animation` around one keyframe. The keyframe and pixels that show no edited part of it are fixed."""

    def __init__(self, propagator: Propagator, key: int, painting: Frame) -> None:
        self._propagator, self._key, self._painting = propagator, key, painting
        height, width = propagator.guide(key).shape[:2]
        y, x = np.mgrid[:height, :width].astype(np.float32)
        self._identity: Offsets = np.ascontiguousarray(np.stack([x, y], -1))

    def target(self, index: int) -> Target:
        return Target(self._propagator.guide(index))

    def motion(self, index: int, other: int) -> Motion:
        return self._propagator.motion(index, other)

    def fixed_offsets(self, index: int) -> Offsets | None:
        if index == self._key:
            return self._identity
        before = self._propagator.result(self._key, index)
        if before is None:
            return None
        # Results may stem from different paintings, because a call can be abandoned: compare each with its own.
        painting, offsets = before
        changed = self._propagator.changed(painting, self._painting)
        at = np.rint(offsets).astype(np.int64)
        height, width = changed.shape
        edited = changed[at[..., 1].clip(0, height - 1), at[..., 0].clip(0, width - 1)]
        return np.where(edited[..., None] > 0, NOWHERE, offsets).astype(np.float32)

    def previous(self, index: int, state: FrameState[Any]) -> Any:
        """Initial offsets of pixels to which nothing is advected: the same position in the keyframe."""
        return self._propagator.upload(self._identity)

    def merge_probability(self, index: int, forward: bool) -> float:
        return 1.0

    def ribbons(self, index: int) -> Offsets | None:
        return None
