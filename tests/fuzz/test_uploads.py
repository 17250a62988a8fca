"""A few mutated uploads of every kind in every run of the suite; `make fuzz` makes many more."""

from __future__ import annotations

from pathlib import Path

from tests.fuzz import uploads


def test_no_mutated_upload_makes_a_5xx(tmp_path: Path) -> None:
    with uploads.service(tmp_path) as client:
        found = {
            case.id: uploads.outcome(client, case, previews=number == 2 and case.kind in ("mp4", "gif", "png"))
            for number in range(4)
            for case in uploads.cases(0, number)
        }
    assert {name: what for name, what in found.items() if what.startswith("fault")} == {}
    assert {"accepted", "refused"} <= set(found.values())
