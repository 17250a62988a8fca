"""The store: the truth about assets, jobs, keys and webhooks, in SQLite or PostgreSQL."""

from __future__ import annotations

from workers.store.assets import Assets
from workers.store.base import Clock
from workers.store.bell import Bell
from workers.store.book import Policy
from workers.store.context import Context
from workers.store.database import Database
from workers.store.fleet import Fleet
from workers.store.history import History
from workers.store.jobs import Accepted, Jobs
from workers.store.keys import Keys
from workers.store.overview import Overview
from workers.store.plans import Plans, StepToPlan
from workers.store.tally import Tally
from workers.store.webhooks import Webhooks
from workers.store.work import Claim, Sign, Work


class Store:
    """Every part of the store over one database. Thread-safe; several processes may open the same one.

    Args:
        url: SQLAlchemy URL.
        policy: when to give up, how much history to keep.
        now: the clock, s since the epoch; None: the database's, which all its users share.

    Raises:
        StorageError: the database cannot be reached.
    """

    def __init__(self, url: str, policy: Policy | None = None, now: Clock | None = None) -> None:
        self._db = Database(url)
        shared = (self._db, Bell(), policy or Policy(), now or self._db.now)
        tally = Tally()
        self.assets = Assets(*shared)
        self.jobs = Jobs(*shared)
        self.history = History(*shared)
        self.plans = Plans(*shared)
        self.work = Work(*shared, tally)
        self.context = Context(*shared)
        self.overview = Overview(*shared, tally)
        self.fleet = Fleet(*shared)
        self.keys = Keys(*shared)
        self.webhooks = Webhooks(*shared)

    def check(self) -> None:
        """Raise StorageError if the database does not answer now."""
        self._db.check()

    def close(self) -> None:
        self._db.close()


__all__ = ["Accepted", "Claim", "Policy", "Sign", "StepToPlan", "Store"]
