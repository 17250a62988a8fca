"""`farm.retention`: rules that delete old jobs with their results, and what they delete."""

from __future__ import annotations

import logging
from dataclasses import dataclass

from workers.contract.owners import AuditEntry, RetentionRule
from workers.errors import Conflict, NotFound
from workers.farm_parts.exports import FarmExports
from workers.farm_parts.jobs import FarmJobs
from workers.process.log_context import log_extra
from workers.store import Store

log = logging.getLogger(__name__)

ACTION = "retention"
"""`AuditEntry.action` of a job that a rule has deleted."""
_AT_ONCE = 200


@dataclass(frozen=True)
class Due:
    """What a rule would delete now."""

    jobs: int
    """Number of jobs, counted up to 10,000."""
    first: tuple[str, ...]
    """Ids of the oldest of them."""


class FarmRetention:
    """Rules and their effect. They are applied by the sweeps of the longest-running worker, or by `apply`."""

    MOST_COUNTED = 10_000
    SHOWN = 100

    def __init__(self, store: Store, jobs: FarmJobs, exports: FarmExports) -> None:
        self._store, self._jobs, self._exports = store, jobs, exports

    def rules(self) -> list[RetentionRule]:
        """Oldest first."""
        return self._store.retention.all()

    def add(self, rule: RetentionRule) -> RetentionRule:
        """Raises BadParameter."""
        return self._store.retention.add(rule)

    def remove(self, rule_id: str) -> None:
        """Raises NotFound."""
        self._store.retention.remove(rule_id)

    def due(self, rule: RetentionRule) -> Due:
        """What the rule would delete now. Deletes nothing. Raises BadParameter."""
        found = self._store.retention.due(rule, limit=self.MOST_COUNTED)
        return Due(len(found), tuple(found[: self.SHOWN]))

    def apply(self) -> list[str]:
        """Delete the jobs that a rule fits, with exports and results; returns their ids, which are also in the audit
        trail. A job that is being exported stays until the next time."""
        return [job_id for rule in self.rules() for job_id in self._apply(rule)]

    def _apply(self, rule: RetentionRule) -> list[str]:
        gone: list[str] = []
        after = ""
        while batch := self._store.retention.due(rule, after, _AT_ONCE):
            deleted = [job_id for job_id in batch if self._delete(job_id)]
            self._store.audit.add(*(AuditEntry(ACTION, job_id, user=rule.id) for job_id in deleted))
            gone, after = gone + deleted, batch[-1]
        if gone:
            log.info("rule %s has deleted %d jobs", rule.id, len(gone), extra=log_extra(rule=rule.id))
        return gone

    def _delete(self, job_id: str) -> bool:
        try:
            self._exports.delete(job_id)
            self._jobs.delete(job_id)
        except (Conflict, NotFound):  # exported, retried or deleted meanwhile
            return False
        return True
