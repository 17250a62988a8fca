"""The four dashboards.

Gauges that come from the database are the same from every API process and are joined by max; what a process counts of
itself is summed.
"""

from __future__ import annotations

from deploy.grafana.boards.farm import FARM
from deploy.grafana.boards.live import LIVE
from deploy.grafana.boards.service import SERVICE
from deploy.grafana.boards.stores import STORES

BOARDS = (SERVICE, FARM, LIVE, STORES)
