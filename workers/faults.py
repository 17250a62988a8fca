"""Exceptions as faults: how an error of an attempt, a plan or an order is reported, and whether the task is retried."""

from __future__ import annotations

import errno
import traceback
from collections.abc import Iterator

from pipeline.errors import BadInput, Cancelled, ImpastoError, StorageError, StorageFull
from workers.blobs.keys import NoBlob
from workers.blobs.verified import hash_of_key
from workers.contract.order import TaskOutcome
from workers.contract.record import Fault
from workers.errors import DamagedBlob, NoCapacity, NotFound

RESOURCES_EXHAUSTED = "resources-exhausted"
"""Code: the operating system refused descriptors, processes or memory."""
_DISK_FULL = {errno.ENOSPC, errno.EDQUOT}
_EXHAUSTED = {errno.EMFILE, errno.ENFILE, errno.ENOMEM, errno.EAGAIN}


def failed_outcome(attempt_id: str, error: BaseException) -> TaskOutcome:
    """The outcome of an attempt whose runner raised `error`."""
    log = "".join(traceback.format_exception(error))
    if isinstance(error, Cancelled):
        return TaskOutcome(attempt_id, {}, {}, {}, None, {}, log, cancelled=True)
    return TaskOutcome(attempt_id, {}, {}, {}, None, {}, log, fault=fault_from(error))


def fault_from(error: BaseException) -> Fault:
    """An exception as a Fault.

    An ImpastoError keeps its code, field and remedy. Other exceptions are internal errors, unless a shortage of the
    machine (disk, memory, descriptors) is in their chain of causes.
    """
    if shortage := _shortage(error):
        return shortage
    if isinstance(error, ImpastoError):
        return Fault(error.code, error.message, error.remedy, error.field, error.value)
    if isinstance(error, NoBlob):
        key = str(error.args[0])[:200]
        if sha256 := hash_of_key(key):
            remedy = "Upload the file again, which restores them, then retry the job."
            return Fault(NotFound.code, "The stored bytes of an input are gone.", remedy, "asset", f"ast_{sha256}")
        remedy = "Restore it from a backup, or submit a new job."
        return Fault(NotFound.code, "A file that the job needs is gone.", remedy, "blob", key)
    if isinstance(error, MemoryError):
        return Fault("out-of-memory", "The task needs more memory than there is.", "Use a smaller video.")
    return Fault("internal-error", f"{type(error).__name__}: {error}"[:500], "See the log of the task.")


def _shortage(error: BaseException) -> Fault | None:
    """The fault of a full disk or of exhausted descriptors, processes or memory; None for all other errors."""
    numbers = {cause.errno for cause in _chain(error) if isinstance(cause, OSError)}
    if numbers & _DISK_FULL:
        return Fault(StorageFull.code, f"The disk is full: {error}."[:500], "Free some space on the machine.")
    if numbers & _EXHAUSTED:
        remedy = "Raise the limits of the service (descriptors, processes, memory), or run fewer tasks at once."
        return Fault(RESOURCES_EXHAUSTED, f"The machine has no resources left: {error}."[:500], remedy)
    return None


def _chain(error: BaseException) -> Iterator[BaseException]:
    """The error and its causes, newest first."""
    visited: set[int] = set()
    current: BaseException | None = error
    while current is not None and id(current) not in visited:
        visited.add(id(current))
        yield current
        current = current.__cause__ or current.__context__


def is_final(fault: Fault) -> bool:
    """Whether another attempt would fail in the same way, because the input is wrong or damaged."""
    return fault.code in _FINAL


def is_resource_away(fault: Fault) -> bool:
    """Whether storage, disk space or resources of the machine were missing. The task waits; no attempt is counted."""
    return fault.code in _AWAY


def _codes(kind: type[ImpastoError]) -> set[str]:
    return {kind.code}.union(*(_codes(child) for child in kind.__subclasses__()))


_FINAL = _codes(BadInput) | {NotFound.code, NoCapacity.code, DamagedBlob.code}
_AWAY = _codes(StorageError) | {RESOURCES_EXHAUSTED}
