"""Exceptions as faults: what an attempt, a plan or an order answers when it raises."""

from __future__ import annotations

import traceback

from pipeline.errors import BadInput, Cancelled, ImpastoError, StorageError
from workers.blobs.keys import NoBlob
from workers.errors import NoRoom, NotFound
from workers.model import Fault, TaskOutcome


def failed_outcome(attempt_id: str, error: BaseException) -> TaskOutcome:
    """What an attempt answers when its runner raises instead of answering."""
    log = "".join(traceback.format_exception(error))
    if isinstance(error, Cancelled):
        return TaskOutcome(attempt_id, {}, {}, {}, None, {}, log, cancelled=True)
    return TaskOutcome(attempt_id, {}, {}, {}, None, {}, log, fault=fault_from(error))


def fault_from(error: BaseException) -> Fault:
    """An exception as a Fault: ours keep code, field and remedy; others are internal errors."""
    if isinstance(error, ImpastoError):
        return Fault(error.code, error.message, error.remedy, error.field, error.value)
    if isinstance(error, NoBlob):
        remedy = "Restore it from a backup, or upload the input again and submit a new job."
        return Fault(NotFound.code, "Bytes that the task needs are gone.", remedy, "blob", str(error.args[0])[:200])
    if isinstance(error, MemoryError):
        return Fault("out-of-memory", "The task needs more memory than there is.", "Use a smaller video.")
    return Fault("internal-error", f"{type(error).__name__}: {error}"[:500], "See the log of the task.")


def is_final(fault: Fault) -> bool:
    """Whether trying again cannot help: the same input is wrong the same way."""
    return fault.code in _FINAL


def is_storage_away(fault: Fault) -> bool:
    """Whether the task only met a store that was away for a while."""
    return fault.code == StorageError.code


def _codes(kind: type[ImpastoError]) -> set[str]:
    return {kind.code}.union(*(_codes(child) for child in kind.__subclasses__()))


_FINAL = _codes(BadInput) | {NotFound.code, NoRoom.code}
