"""Whether anything that we install is known to be vulnerable: `python .ci/audit.py`.

Exit status 1 for a finding. A machine that cannot ask (no network, an index without advisories) is said so and passes:
what is not known is no finding, and a build must not depend on a server elsewhere.
"""

from __future__ import annotations

import json
import subprocess
import sys
from typing import Any

COMMAND = (sys.executable, "-m", "pip_audit", "--local", "--skip-editable", "--progress-spinner=off", "--format=json")
TIMEOUT_S = 300


def asked() -> tuple[str, str]:
    """What pip-audit says: (JSON, or nothing; complaints)."""
    try:
        done = subprocess.run(COMMAND, capture_output=True, text=True, timeout=TIMEOUT_S, check=False)  # noqa: S603
    except subprocess.TimeoutExpired:
        return "", f"no answer within {TIMEOUT_S} s"
    return done.stdout, done.stderr


def judged(said: str, complaint: str) -> tuple[int, str]:
    """Exit status, and what to tell a person."""
    try:
        rows: list[dict[str, Any]] = json.loads(said)["dependencies"]
    except (ValueError, KeyError, TypeError):
        last = (complaint.strip().splitlines() or ["it said nothing"])[-1]
        return 0, f"NOT AUDITED: pip-audit could not ask: {last}"
    found = [_line(row, hole) for row in rows for hole in row.get("vulns", ())]
    if found:
        return 1, "\n".join(["Known vulnerabilities:", *found])
    known = sum("skip_reason" not in row for row in rows)
    if not known:
        return 0, f"NOT AUDITED: the index knows no advisories of any of {len(rows)} packages"
    return 0, f"{known} of {len(rows)} packages audited: nothing known"


def _line(row: dict[str, Any], hole: dict[str, Any]) -> str:
    mended = ", ".join(hole.get("fix_versions", ())) or "no version yet"
    return f"{row['name']} {row.get('version', '')}: {hole['id']}, mended in {mended}"


if __name__ == "__main__":
    status, text = judged(*asked())
    print(text)
    sys.exit(status)
