"""Compiles and loads kernels ahead of time, so that the first frame takes as long as later ones.

On a machine that has never run them, compiling all kernels takes a minute or more; they are then cached on disk, and
loading them takes half a second a process.
"""

from __future__ import annotations

import contextlib
import logging
import threading
from collections.abc import Callable, Iterator
from itertools import islice

import cv2
import numpy as np

from pipeline.errors import ImpastoError
from pipeline.frames import Frame
from pipeline.methods import methods
from pipeline.methods.base import Method, Params
from workers.process.starting import WARM_UP_THREAD

log = logging.getLogger(__name__)

SIZE = (352, 288)
"""(width, height) of the practice frames, px: large enough that no filter, scaled to the frame, is left out."""
FRAMES = 4
"""Practice frames at either size."""
PRACTICE_FACE = [
    (100, 170, 25, 32, (205, 160, 130)),
    *((100 + side, 156, 6, 2, (70, 45, 35)) for side in (-10, 10)),
    *((100 + side, 162, 5, 3, (90, 60, 50)) for side in (-10, 10)),
    (100, 179, 5, 2, (130, 90, 75)),
    (100, 188, 9, 3, (140, 60, 60)),
]
"""A face in the practice frames that the detector finds, as ellipses: centre x, centre y and semi-axes, px; colour."""
JOB_FRAMES = 2
"""Practice frames of a render of one job: nearly all kernels are called in the second frame, and further practice would
take longer than loading the few others when they are called."""

_practised = threading.Event()
_one_at_a_time = threading.Lock()
_begun: list[threading.Thread] = []
"""Threads of `begin_warm_up`."""


def warm_up(chosen: Method, params: Params, stopped: Callable[[], bool] = lambda: False) -> None:
    """Run a causal method on a few small frames with the given parameters, so that its code is compiled and loaded in
    this process.

    Half of the frames are analyzed at half the size, as in a live session that works at a reduced size. A method that
    is not causal, or that finds the frames too small for its parameters, is not warmed up.

    Args:
        stopped: called between frames; True ends the warm-up.
    """
    with contextlib.suppress(ImpastoError):
        if (session := chosen.stream(params, SIZE, 0, {})) is not None:
            for frame in _practice():
                if stopped():
                    return
                session.step(frame)
            session = session.reconfigure(params, (SIZE[0] // 2, SIZE[1] // 2), None, SIZE)
            for frame in _practice():
                if stopped():
                    return
                session.step(np.ascontiguousarray(frame[::2, ::2]))


def begin_warm_up(chosen: Method, params: Params) -> None:
    """`load` and a short practice on a thread, beside the start of a job; `finish_warm_up` waits for it."""
    thread = threading.Thread(target=_load_and_practise, args=(chosen, params), name=WARM_UP_THREAD, daemon=True)
    _practised.set()
    _begun.append(thread)
    thread.start()


def finish_warm_up() -> None:
    """Wait for the thread of `begin_warm_up`, so that the time of a painting step does not include loading."""
    for thread in _begun:
        thread.join()


def _load_and_practise(chosen: Method, params: Params) -> None:
    with contextlib.suppress(ImpastoError):
        chosen.load()
    with _logged(chosen), contextlib.suppress(ImpastoError):
        if (session := chosen.stream(params, SIZE, 0, {})) is not None:
            for frame in islice(_practice(face=False), JOB_FRAMES):
                session.step(frame)


@contextlib.contextmanager
def _logged(chosen: Method) -> Iterator[None]:
    """Logs the error of a method that practises; the method raises it again when it is used."""
    try:
        yield
    except Exception:
        log.warning("The method %s could not practise.", chosen.name, exc_info=True)


def warm_up_process(stopped: Callable[[], bool] = lambda: False) -> None:
    """Warm up every method with its defaults, once per process. Never raises."""
    with _one_at_a_time:
        if _practised.is_set():
            return
        _practised.set()
        for chosen in methods().values():
            with _logged(chosen):
                warm_up(chosen, chosen.Params(), stopped)


def _practice(face: bool = True) -> Iterator[Frame]:
    """A bright square that moves over a ramp, a narrow orange stripe on a white one, and a face: edges, motion, more
    than one region, ink that is taken off, and what is done for faces.

    Args:
        face: whether there is one; it adds half a second to the start of a job, which may have none.
    """
    width, height = SIZE
    for index in range(FRAMES):
        frame = np.empty((height, width, 3), np.uint8)
        frame[...] = np.linspace(20, 120, width, dtype=np.uint8)[:, None]
        frame[100:220, 200:300] = 240
        frame[110:210, 249:252] = (220, 120, 20)
        frame[16:48, 20 + 2 * index : 52 + 2 * index] = (230, 180, 60)
        for x, y, half_width, half_height, colour in PRACTICE_FACE if face else ():
            cv2.ellipse(frame, (x, y), (half_width, half_height), 0, 0, 360, colour, cv2.FILLED)
        yield frame
