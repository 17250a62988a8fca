"""The store: assets, jobs, keys and webhooks in SQLite or PostgreSQL. The database is the source of truth."""

from __future__ import annotations

from workers.store.accepted_job import Accepted
from workers.store.assets import Assets
from workers.store.audit import Audit
from workers.store.base import Clock
from workers.store.bulk import Bulk
from workers.store.claims import Claim, ClaimFailed
from workers.store.comments import Comments
from workers.store.costs import Costs
from workers.store.counters import AttemptCounters
from workers.store.database import Database
from workers.store.event_notifier import EventNotifier
from workers.store.events import Events
from workers.store.job_transaction import StorePolicy
from workers.store.jobs import Jobs
from workers.store.keys import Keys
from workers.store.owners import Owners
from workers.store.plans import Plans, StepToPlan
from workers.store.projects import StoredProjects
from workers.store.retention import RetentionRules
from workers.store.reuse import Reuse
from workers.store.statistics import Statistics
from workers.store.task_inputs import TaskInputs
from workers.store.task_queue import Heartbeat, TaskQueue
from workers.store.tasks import Tasks
from workers.store.validation import Validation
from workers.store.webhooks import Webhooks
from workers.store.workers import Workers


class Store:
    """Every part of the store over one database. Thread-safe; several processes may open the same one.

    Args:
        url: SQLAlchemy URL.
        policy: retries and the length of histories.
        now: clock, seconds since the epoch; None: the clock of the database, which all processes share.

    Attributes:
        database: the connection that all parts share.

    Raises:
        StorageError: the database cannot be reached.
    """

    def __init__(self, url: str, policy: StorePolicy | None = None, now: Clock | None = None) -> None:
        policy = policy or StorePolicy()
        self.database = Database(url, policy.durable)
        shared = (self.database, EventNotifier(), policy, now or self.database.now)
        counters = AttemptCounters()
        self.assets = Assets(*shared)
        self.jobs = Jobs(*shared)
        self.bulk = Bulk(*shared)
        self.tasks = Tasks(*shared)
        self.events = Events(*shared)
        self.plans = Plans(*shared)
        self.queue = TaskQueue(*shared, counters)
        self.task_inputs = TaskInputs(*shared)
        self.statistics = Statistics(*shared, counters)
        self.workers = Workers(*shared)
        self.keys = Keys(*shared)
        self.owners = Owners(*shared)
        self.audit = Audit(*shared)
        self.costs = Costs(*shared)
        self.retention = RetentionRules(*shared)
        self.projects = StoredProjects(*shared)
        self.comments = Comments(*shared)
        self.reuse = Reuse(*shared)
        self.webhooks = Webhooks(*shared)
        self.validation = Validation(*shared)

    def check(self) -> None:
        """Raise StorageError if the database does not answer now."""
        self.database.check()

    def close(self) -> None:
        self.database.close()


__all__ = ["Accepted", "Claim", "ClaimFailed", "Heartbeat", "StepToPlan", "Store", "StorePolicy"]
