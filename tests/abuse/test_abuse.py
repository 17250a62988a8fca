"""The short form of `make abuse`: every attack for a second, on one service."""

from __future__ import annotations

import pytest

from tests.abuse.__main__ import row, run
from tests.abuse.attacks import ATTACKS, CONTROL
from tests.abuse.measure import HEALTH_S, LISTING_S, Found, p99

pytestmark = pytest.mark.serial
SECONDS = 1.0
USUAL_S = 0.05
"""What /healthz takes at the 99th percentile on an idle machine; a busier one has as much more time."""


def test_no_attack_of_one_key_stops_the_service_for_others() -> None:
    late = _failing(list(ATTACKS))
    again = _failing([CONTROL, *late]) if late else {}  # one second is short: another program can have caused it
    assert not [one for name, one in again.items() if name in late]


def _failing(names: list[str]) -> dict[str, str]:
    """The attacks among these that harm others: name -> its measurements."""
    found = list(run(names, SECONDS))
    control = next(one for one in found if one.name == CONTROL)
    busier = max(1.0, p99(control.health_s) / USUAL_S)
    return {one.name: row(one) for one in found if _failed(one, busier)}


def _failed(found: Found, busier: float) -> bool:
    late = p99(found.health_s) > HEALTH_S * busier or p99(found.listing_s) > LISTING_S * busier
    return late or any("/healthz" not in fault and "listing" not in fault for fault in found.faults)
