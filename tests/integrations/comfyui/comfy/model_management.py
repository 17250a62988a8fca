"""ComfyUI's interruption: a flag, which the next question takes back and raises."""

import threading

_interrupted = threading.Event()


class InterruptProcessingException(Exception):
    pass


def throw_exception_if_processing_interrupted():
    if _interrupted.is_set():
        _interrupted.clear()
        raise InterruptProcessingException


def interrupt_current_processing(value=True):
    _interrupted.set() if value else _interrupted.clear()
