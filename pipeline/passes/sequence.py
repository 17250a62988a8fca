"""Passes of a sequence of images, frame by frame: motion, mattes, object numbers and data."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import AnyArray
from pipeline.errors import BadParameter, UnreadableMedia
from pipeline.formats import has_planes
from pipeline.formats.base import Choice, PlaneImage
from pipeline.frames import Flow, Frame, Plane
from pipeline.passes.cryptomatte import cryptomattes
from pipeline.passes.facts import PassFacts, known_vectors
from pipeline.passes.find import Where, described, layers_of, object_ids
from pipeline.passes.vectors import Factors, VectorFacts, completed, of_pair, vector_facts, vector_pass
from pipeline.perception.flow.warp import scale_flow
from pipeline.video.numbering import frame_numbers
from pipeline.video.passes import picture, picture_choice, samples, settled_choice
from pipeline.video.sequence_options import USUAL, SequenceOptions
from pipeline.video.shot_archive import LayerFiles, sequence_layout
from pipeline.video.shot_files import FRAMES, Files

Decode = Callable[[bytes, str], PlaneImage]
"""Decodes an image with planes, given its bytes and name."""
DecodeRaw = Callable[[bytes, str], AnyArray]
"""Decodes another image: uint8 or uint16, (h, w), (h, w, 3) or (h, w, 4)."""
OFF = "off"
"""Convention of vectors that are not used."""
_MAX_IMAGES, _MAX_PAIRS = 3, 4
_STILL_LEVELS = 0.5
"""Mean difference of two pictures, gray levels, from which they tell the convention of motion vectors."""


class PassSequence:
    """The passes of a sequence or a shot. Safe for several threads.

    Args:
        files: by path.
        layer: paths of the frames, and of separate files with vectors.
        decode, decode_raw: decode images, with planes and others; where the process is not confined, in a guarded one.
        options: which picture is read, and the stated convention of motion vectors.
        stated: the convention that shot.json states.
    """

    def __init__(
        self, files: Files, layer: LayerFiles, decode: Decode, decode_raw: DecodeRaw, options: SequenceOptions,
        stated: str | Factors | None = None,
    ) -> None:  # fmt: skip
        self._files, self._decode, self._decode_raw, self._options = files, decode, decode_raw, options
        self._stated: str | Factors = options.vectors if options.vectors != "auto" or stated is None else stated
        self._frames, self._vectors = dict(layer.passes[FRAMES]), dict(layer.passes["vectors"])
        self._images: OrderedDict[str, PlaneImage] = OrderedDict()
        self._pairs: OrderedDict[int, tuple[Flow, Flow] | None] = OrderedDict()
        self._lock = threading.RLock()
        self._adjacent = _adjacent(self._frames, getattr(files, "held", frozenset()))
        self._choice: Choice | None = None
        self._vector_facts: VectorFacts | None = None
        self._is_known = False

    @property
    def has_planes(self) -> bool:
        """Whether the frames or their vectors are images with planes."""
        return any(has_planes(path) for path in (*self._frames.values(), *self._vectors.values()))

    # -- facts

    @property
    def choice(self) -> Choice:
        """Which picture of the frames is read."""
        if self._choice is None:
            path = self._frames[0]
            self._choice = self._options.choice
            if has_planes(path):
                self._choice = settled_choice(self._choice, self._image(path), self._samples)[0]
        return self._choice

    def _samples(self) -> Iterator[PlaneImage]:
        return (self._image(self._frames[index]) for index in samples(len(self._frames)))

    @property
    def where(self) -> Where:
        """Where the passes are."""
        return self._where(self._frames[0])

    def _where(self, path: str) -> Where:
        found = picture_choice(self._image(path), self.choice) if has_planes(path) else None
        return Where("" if found is None else found.layer, self._options.view)

    @property
    def vectors(self) -> VectorFacts | None:
        """What is known about the motion vectors; None: there are none, or they are not wanted."""
        with self._lock:
            if not self._is_known:
                self._is_known, self._vector_facts = True, self._found_vectors()
            return self._vector_facts

    def know(self, vectors: VectorFacts | None) -> None:
        """Take over what was found earlier about the motion vectors."""
        self._is_known, self._vector_facts = True, vectors

    def _found_vectors(self) -> VectorFacts | None:
        try:
            return self._tried_vectors()
        except UnreadableMedia:
            return None

    def _tried_vectors(self) -> VectorFacts | None:
        if self._stated == OFF or len(self._frames) < 2 or self._vector_path(0) is None:
            return None
        if vector_pass(self._image(self._vector_path(0) or ""), self.where) is None:
            return None
        pairs = [index for index in pairs_of(len(self._frames)) if self._adjacent.get(index)]
        best: tuple[float, int] = (-1.0, -1)
        for index in pairs:
            apart = float(np.abs(self.picture(index).astype(np.float32) - self.picture(index + 1)).mean())
            best = max(best, (apart, index))
            if apart >= _STILL_LEVELS:
                break
        if best[1] < 0:
            return None
        index = best[1]
        first, second = ((self._image(self._vector_path(k) or ""), self.picture(k)) for k in (index, index + 1))
        return vector_facts(first, second, self._stated, self.where)

    def facts(self) -> PassFacts:
        """What the sequence holds."""
        path = self._vector_path(0)
        image = self._image(self._frames[0]) if has_planes(self._frames[0]) else None
        passes = {} if image is None else dict(described(image, self.where))
        if path is not None and path != self._frames[0]:
            passes |= {k: one for k, one in described(self._image(path)) if k in ("vectors", "next", "previous")}
        mattes: tuple[str, ...] = ()
        if image is not None and (found := cryptomattes(image, self.where)):
            mattes = tuple(sorted(found[0].names)) or ("(no names)",)
        layers = () if image is None else tuple(dict.fromkeys(layer for layer, _ in layers_of(image)))
        views = () if image is None else image.views
        return PassFacts(self.where.picture, self._options.view, passes, self.vectors, mattes, layers, views)

    def numbers(self) -> list[int]:
        """Numbers in the names of the frames' files."""
        return [number or 0 for number in frame_numbers(self._frames.values()).values()]

    # -- frame by frame

    def __len__(self) -> int:
        return len(self._frames)

    def picture(self, index: int) -> Frame:
        """The picture of a frame, uint8 (h, w, 3), without its opacity."""
        path = self._frames[index]
        if not has_planes(path):
            raw = self._decode_raw(self._files[path], path)
            eight = raw if raw.dtype == np.uint8 else (raw >> 8).astype(np.uint8)
            return np.dstack([eight] * 3) if eight.ndim == 2 else np.ascontiguousarray(eight[..., :3])
        found = picture(self._image(path), self.choice)
        if found is None:
            raise BadParameter("The image has no picture.", field=path, remedy="Render R, G and B into it.")
        return np.ascontiguousarray(found[..., :3])

    def motion(self, index: int) -> tuple[Flow, Flow] | None:
        """V+ of a frame and V- of the next one, float32 (h, w, 2), px of the images, y down, see `vectors`; None: they
        are not known for these frames."""
        with self._lock:
            if index not in self._pairs:
                self._pairs[index] = self._motion(index)
                while len(self._pairs) > _MAX_PAIRS:
                    self._pairs.popitem(last=False)
            return self._pairs[index]

    def _motion(self, index: int) -> tuple[Flow, Flow] | None:
        try:
            return self._read_motion(index)
        except UnreadableMedia:  # the job says what happens to damaged frames when it reads their pictures
            return None

    def _read_motion(self, index: int) -> tuple[Flow, Flow] | None:
        facts = self.vectors
        if facts is None or not facts.used or not self._adjacent.get(index):
            return None
        first, second = (self._image(self._vector_path(k) or "") for k in (index, index + 1))
        found = of_pair(facts, first, second, self.where)
        if found.plus is not None and found.minus is not None:
            return found.plus, found.minus
        return completed(found, self.picture(index), self.picture(index + 1))

    def flow(self, first: int, second: int, size: tuple[int, int]) -> Flow | None:
        """Flow from a frame to its neighbour: first(x) matches second(x + flow(x)).

        Args:
            first, second: numbers of consecutive frames, in any order.
            size: (width, height) of the flow, px.

        Returns:
            float32 (height, width, 2), px of that size; None: it is not known for these frames.
        """
        if abs(first - second) != 1 or (found := self.motion(min(first, second))) is None:
            return None
        flow = found[0] if second > first else -found[1]
        if (flow.shape[1], flow.shape[0]) == size:
            return flow.copy()
        fitted = np.asarray(cv2.resize(flow, size, interpolation=cv2.INTER_NEAREST_EXACT), np.float32)
        return scale_flow(fitted, size[0] / flow.shape[1], size[1] / flow.shape[0])

    def matte(self, index: int, *objects: str) -> Plane:
        """Coverage of objects by the Cryptomatte, float32 (h, w), 0..1. Raises BadParameter: no such object."""
        image = self._image(self._frames[index])
        found = cryptomattes(image, self.where)
        if not found:
            raise BadParameter("The frames have no Cryptomatte.", field="object", value=", ".join(objects),
                               remedy="Render its pass, and save multi-layer images.")  # fmt: skip
        return found[0].matte(image, *objects)

    def labels(self, index: int) -> NDArray[np.int32] | None:
        """Number of the object at each pixel, int32 (h, w): of the index pass, else of the Cryptomatte."""
        return labels_of(self._image(self._frames[index]), self.where)

    def data(self, index: int, read: Callable[[PlaneImage, Where], AnyArray | None]) -> AnyArray | None:
        """A pass of a frame, read by one of the functions of `pipeline.passes.find`."""
        return read(self._image(self._frames[index]), self.where)

    def _vector_path(self, index: int) -> str | None:
        path = self._vectors.get(index) or self._frames[index]
        return path if has_planes(path) else None

    def _image(self, path: str) -> PlaneImage:
        with self._lock:
            if path not in self._images:
                self._images[path] = self._decode(self._files[path], path)
                if len(self._images) > _MAX_IMAGES:
                    self._images.popitem(last=False)
            self._images.move_to_end(path)
            return self._images[path]


def labels_of(image: PlaneImage, where: Where) -> NDArray[np.int32] | None:
    """Number of the object at each pixel, int32 (h, w): of the index pass, else of the Cryptomatte; None: neither."""
    if (found := object_ids(image, where)) is not None:
        return found
    mattes = cryptomattes(image, where)
    return mattes[0].labels(image) if mattes else None


def pairs_of(count: int) -> list[int]:
    """First frames of the pairs that are looked at for the convention of vectors, the middle one first."""
    return list(dict.fromkeys([max(0, count // 2 - 1), 0, max(0, count - 2)]))


def _adjacent(frames: dict[int, str], held: frozenset[str]) -> dict[int, bool]:
    """Whether a frame and the next one are consecutive frames of the renderer: neither is used for a missing one."""
    numbers = frame_numbers(frames.values())
    steps = {k: (numbers[frames[k + 1]] or 0) - (numbers[frames[k]] or 0) for k in frames if k + 1 in frames}
    least = min(steps.values(), default=1)
    return {k: step == least and not {frames[k], frames[k + 1]} & held for k, step in steps.items()}


def pass_sequence(
    files: Files, decode: Decode, decode_raw: DecodeRaw, facts: Mapping[str, Any] | None = None
) -> PassSequence | None:
    """The passes of the files of an archive; None: they are no sequence of images with planes.

    Args:
        facts: `PassFacts.as_json` of the sequence, if they are known: vectors are not looked at again for them.

    Raises: UnreadableMedia: see `sequence_layout`.
    """
    found_layout = sequence_layout(files) if files else None
    if found_layout is None or not found_layout.layout.frames:
        return None
    layout, files = found_layout
    options: SequenceOptions = getattr(files, "options", USUAL)
    found = PassSequence(files, layout.whole, decode, decode_raw, options, layout.settings.vectors)
    if facts:
        found.know(known_vectors(facts))
    return found if found.has_planes else None
