"""The four dashboards.

Every API process exports the same gauges from the database; queries combine them with max. Metrics that a process
counts for itself are summed.
"""

from __future__ import annotations

from deploy.grafana.boards.farm import FARM
from deploy.grafana.boards.live import LIVE
from deploy.grafana.boards.service import SERVICE
from deploy.grafana.boards.stores import STORES

BOARDS = (SERVICE, FARM, LIVE, STORES)
