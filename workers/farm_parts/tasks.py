"""`farm.tasks`: the tasks of jobs with their attempts and logs."""

from __future__ import annotations

from collections.abc import Callable

from workers.contract.record import Page, TaskView
from workers.store import Store


class FarmTasks:
    """
    Args:
        wake: called after every change that may let a task start.
    """

    def __init__(self, store: Store, wake: Callable[[], None]) -> None:
        self._store, self._wake = store, wake

    def page(self, job_id: str, state: str | None = None, cursor: str | None = None, limit: int = 100) -> Page:
        """`TaskView` items in plan order. Raises NotFound."""
        return self._store.tasks.page(job_id, state, cursor, limit)

    def get(self, task_id: str) -> TaskView:
        """Raises NotFound."""
        return self._store.tasks.get(task_id)

    def log(self, task_id: str) -> str:
        """Logs of all attempts of the task, oldest first. Raises NotFound."""
        return self._store.tasks.log(task_id)

    def requeue(self, task_id: str, max_active: int | None = None) -> TaskView:
        """Run one failed or cancelled task again. Raises Conflict, NotFound, QuotaExceeded.

        Args:
            max_active: unfinished jobs that the owner may have, this one's included; None: any number.
        """
        self._store.jobs.requeue(task_id, max_active)
        self._wake()
        return self.get(task_id)
