"""`LiveRenderer`: the work of one session, in any process. No event loop, no Ray; called from two threads.

    analysis thread    open, analyze, change, close    decode, scale, `session.analyze`
    paint thread       paint                           `session.paint`, encode

The result of `analyze` is passed to `paint` within the process, so that no frame is copied between processes. Every
`analyze` is followed by one `paint`, in the same order; `paint` raises the errors of both.
"""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from queue import Queue

import cv2
import numpy as np

from pipeline.errors import BadInput, BadParameter, ImpastoError
from pipeline.frames import Frame
from pipeline.methods import method, parse_params
from pipeline.methods.base import LiveFilter, Method, References, Session
from workers.blobs.base import Blobs
from workers.errors import NotFound
from workers.execution.decoders import Decoders
from workers.execution.renderer import prepare_process
from workers.execution.warm_up import warm_up_process
from workers.live.codecs import Decoder, Encoder, decoder, encoder
from workers.live.model import FilterOrder, FrameRequest, LiveOrder, RenderedFrame, Size

MAX_REFERENCE_FRAMES = 600
"""Colours are learned from a reference while the client waits."""
_AHEAD = 2


@dataclass(frozen=True)
class _Analysis:
    """The result of the analysis thread for one frame."""

    session: Session
    value: object
    key: bool
    stages_s: dict[str, float]
    behind: tuple[LiveFilter, object] | None
    """The filter, and its own analysis of the frame."""
    size: Size
    """Working size (width, height), px."""


class LiveRenderer:
    """
    Args:
        blobs: where references are.
        find: finds a method by name; by default, the registry.
        threads: number of OpenCV's threads in this process. More threads finish a frame sooner, with the same bytes.
    """

    def __init__(self, blobs: Blobs, find: Callable[[str], Method] = method, threads: int = 1) -> None:
        prepare_process()
        self._threads = threads
        self._find = find
        self._blobs = blobs
        self._decoders = Decoders(blobs)
        self._helper = ThreadPoolExecutor(1, thread_name_prefix="impasto-aside")
        self._beside = ThreadPoolExecutor(1, thread_name_prefix="impasto-filter")
        self._analyses: Queue[_Analysis | Exception] = Queue(_AHEAD)
        self._news = threading.Condition()
        self._ahead = 0
        """Number of frames analyzed and not yet painted."""
        self._order: LiveOrder | None = None
        self._session: Session | None = None
        self._filter: LiveFilter | None = None
        self._decoder: Decoder | None = None
        self._encoder: tuple[Size, Encoder] | None = None
        self._size: Size = (0, 0)
        self._output_size: Size = (0, 0)

    def warm_up(self) -> None:
        """Load kernels before the first frame, once per process. Never raises."""
        cv2.setNumThreads(self._threads)
        warm_up_process()

    def open(self, order: LiveOrder) -> None:
        """Start a stream; if one is open, continue it for another connection.

        Raises:
            BadParameter, BadMedia, BadInput: the method, its parameters or a reference cannot be used.
            NotFound: a reference no longer exists.
        """
        self._renew_threads()
        before = self._order
        if before is None or (before.method, before.seed) != (order.method, order.seed):
            self._session, self._size, self._output_size = self._begin(order), order.size, order.size
            self._filter = self._filter_of(order.filter, None)
        elif _painting(before) != _painting(order):
            self.change(order)
        self._order = order
        self._decoder, self._encoder = decoder(order.wire.send, order.max_side_px), None

    def _renew_threads(self) -> None:
        """Restart OpenCV's threads with the priority of this thread. They inherit the priority of the thread that
        started them, which was the warm-up's, the lowest; frames would then be late on a busy machine."""
        cv2.setNumThreads(1)
        cv2.setNumThreads(self._threads)

    def _begin(self, order: LiveOrder) -> Session:
        chosen = self._find(order.method)
        params = parse_params(chosen, order.params)
        session = chosen.stream(params, order.size, order.seed, self._references(order))
        if session is None:
            raise BadParameter("This method cannot run live.", field="method", value=order.method)
        session.use_helper(self._helper)
        return session

    def analyze(self, work: FrameRequest) -> None:
        """First stage of a frame: decode, scale and `session.analyze`."""
        result: _Analysis | Exception
        try:
            result = self._analyze(work)
        except Exception as error:
            result = error
        with self._news:
            self._ahead += 1
        self._analyses.put(result)

    def paint(self) -> RenderedFrame:
        """Second stage of the oldest analyzed frame; waits for its analysis.

        Raises: BadFrame (a payload is not a frame), and the errors of the method.
        """
        result = self._analyses.get()
        try:
            if isinstance(result, Exception):
                raise result
            return self._paint(result)
        finally:
            with self._news:
                self._ahead -= 1
                self._news.notify_all()

    def change(self, order: LiveOrder) -> None:
        """Apply the parameters, references and filter of this order from the next frame on. Raises like `open`; nothing
        is changed then."""
        before = self._order
        assert before is not None and self._session is not None
        params = parse_params(self._find(before.method), order.params)
        references = None if order.inputs == before.inputs else self._references(order)
        self._wait_until_painted()
        behind = self._filter_of(order.filter, before.filter)
        self._session = self._session.reconfigure(params, self._size, references, self._output_size)
        self._filter = behind
        self._order = replace(before, params=order.params, inputs=order.inputs, filter=order.filter)

    def close(self) -> None:
        """Close the stream. The renderer may be opened again."""
        self._wait_until_painted()
        self._order = self._session = self._filter = self._decoder = self._encoder = None

    def _filter_of(self, order: FilterOrder | None, before: FilterOrder | None) -> LiveFilter | None:
        """The filter of an order. The present filter, made for `before`, is continued if it has the same method."""
        if order is None or order == before:
            return self._filter if order else None
        chosen = self._find(order.method)
        params = parse_params(chosen, order.params)
        if self._filter is not None and before is not None and before.method == order.method:
            return self._filter.reconfigure(params, self._size)
        made = chosen.live_filter(params, self._size)
        if made is None:
            raise BadParameter("This method is not a live filter.", field="filter.method", value=order.method)
        return made

    # -- the analysis thread

    def _analyze(self, work: FrameRequest) -> _Analysis:
        began = time.perf_counter()
        frame = self._decode(work)
        decoded = time.perf_counter()
        session = self._session_for(work.work_size, work.size)
        beside = None if self._filter is None else self._beside.submit(self._filter.analyze, frame)
        value = session.analyze(frame)
        behind = None if self._filter is None or beside is None else (self._filter, beside.result())
        analyzed = time.perf_counter()
        return _Analysis(
            session,
            value,
            work.key,
            {"decode": decoded - began, "analyze": analyzed - decoded},
            behind,
            work.work_size,
        )

    def _decode(self, work: FrameRequest) -> Frame:
        assert self._decoder is not None
        for payload in work.payloads[:-1]:
            self._decoder.decode(payload, work.size)
        frame = self._decoder.decode(work.payloads[-1], work.size)
        if work.work_size == work.size:
            return frame
        return _resized(frame, work.work_size)

    def _session_for(self, size: Size, output_size: Size) -> Session:
        assert self._order is not None and self._session is not None
        if (size, output_size) != (self._size, self._output_size):
            self._wait_until_painted()
            params = parse_params(self._find(self._order.method), self._order.params)
            self._output_size = output_size
            self._session = self._session.reconfigure(params, size, None, self._output_size)
            if self._filter is not None and self._order.filter is not None and size != self._size:
                chosen = self._order.filter
                filter_params = parse_params(self._find(chosen.method), chosen.params)
                self._filter = self._filter.reconfigure(filter_params, size)
            self._size = size
        return self._session

    def _wait_until_painted(self) -> None:
        with self._news:
            self._news.wait_for(lambda: self._ahead == 0)

    def _references(self, order: LiveOrder) -> References:
        documents = {spec.name for spec in self._find(order.method).inputs if spec.kind == "json"}
        return {
            name: self._document(name, key) if name in documents else self._frames(name, key)
            for name, key in order.inputs.items()
        }

    def _document(self, name: str, key: str) -> object:
        try:
            return json.loads(self._blobs.get(key))
        except KeyError:
            raise NotFound("The asset has been deleted.", field=f"inputs.{name}") from None

    def _frames(self, name: str, key: str) -> Iterator[Frame]:
        field = f"inputs.{name}"
        try:
            with self._decoders.reader(key) as reader:
                if reader.frames > MAX_REFERENCE_FRAMES:
                    raise BadInput(
                        f"A live reference has at most {MAX_REFERENCE_FRAMES} frames.",
                        field=field, value=reader.frames, remedy="Use a picture or a shorter video.",
                    )  # fmt: skip
                yield from reader.read()
        except KeyError:
            raise NotFound("The asset has been deleted.", field=field) from None
        except ImpastoError as error:
            error.field = error.field if error.field == field else field
            raise

    # -- the paint thread

    def _paint(self, analysis: _Analysis) -> RenderedFrame:
        began = time.perf_counter()
        frame = analysis.session.paint(analysis.value)
        painted = filtered = time.perf_counter()
        if analysis.behind is not None:
            live_filter, source = analysis.behind
            frame = _filtered(live_filter, source, frame, analysis.size)
            filtered = time.perf_counter()
        data, size, key = self._encoder_for((frame.shape[1], frame.shape[0])).encode(frame, analysis.key)
        encoded = time.perf_counter()
        stages = analysis.stages_s | {"paint": painted - began, "encode": encoded - filtered}
        if analysis.behind is not None:
            stages["filter"] = filtered - painted
        return RenderedFrame(data, size, key, stages)

    def _encoder_for(self, size: Size) -> Encoder:
        assert self._order is not None
        if self._encoder is None or self._encoder[0] != size:
            self._encoder = (size, encoder(self._order.wire, size))
        return self._encoder[1]


def _painting(order: LiveOrder) -> tuple[object, ...]:
    """The parameters and sizes that `LiveRenderer.change` can change."""
    return order.params, order.inputs, order.filter


def _filtered(live_filter: LiveFilter, analysis: object, painted: Frame, size: Size) -> Frame:
    """Apply the filter to a painted frame. The filter works at the working size `size`. Its change of the picture is
    interpolated to the size of a larger painted frame, so that borders and lines keep their width."""
    if painted.shape[1::-1] == size:
        return live_filter.apply(analysis, painted)
    small = _resized(painted, size)
    change = cv2.subtract(live_filter.apply(analysis, small), small, dtype=cv2.CV_16S)
    change = cv2.resize(change, painted.shape[1::-1], interpolation=cv2.INTER_LINEAR)
    return np.asarray(cv2.add(painted, change, dtype=cv2.CV_8U), np.uint8)


def _resized(frame: Frame, size: Size) -> Frame:
    """Scale a frame: halve it while it is at least twice too large, then interpolate bilinearly. This is three times as
    fast as a mean over an arbitrary area."""
    while frame.shape[1] >= 2 * size[0] and frame.shape[0] >= 2 * size[1]:
        half = (frame.shape[1] // 2, frame.shape[0] // 2)
        frame = np.asarray(cv2.resize(frame, half, interpolation=cv2.INTER_AREA), np.uint8)
    return np.asarray(cv2.resize(frame, size, interpolation=cv2.INTER_LINEAR), np.uint8)
