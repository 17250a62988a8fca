"""Check installed packages for known vulnerabilities: `python .ci/audit.py`.

Exit status 1 for a finding. Without access to advisories (no network) the audit prints a notice and passes:
a build must not depend on an external server.
"""

from __future__ import annotations

import json
import subprocess
import sys
from typing import Any

COMMAND = (sys.executable, "-m", "pip_audit", "--local", "--skip-editable", "--progress-spinner=off", "--format=json")
TIMEOUT_S = 300


def asked() -> tuple[str, str]:
    """Run pip-audit. Returns its standard output (JSON, or empty) and its standard error."""
    try:
        done = subprocess.run(COMMAND, capture_output=True, text=True, timeout=TIMEOUT_S, check=False)  # noqa: S603
    except subprocess.TimeoutExpired:
        return "", f"no answer within {TIMEOUT_S} s"
    return done.stdout, done.stderr


def judged(output: str, errors: str) -> tuple[int, str]:
    """Exit status and printed text for the output of pip-audit."""
    try:
        rows: list[dict[str, Any]] = json.loads(output)["dependencies"]
    except (ValueError, KeyError, TypeError):
        last = (errors.strip().splitlines() or ["it printed nothing"])[-1]
        return 0, f"NOT AUDITED: pip-audit failed: {last}"
    found = [_line(row, hole) for row in rows for hole in row.get("vulns", ())]
    if found:
        return 1, "\n".join(["Known vulnerabilities:", *found])
    known = sum("skip_reason" not in row for row in rows)
    if not known:
        return 0, f"NOT AUDITED: the index knows no advisories of any of {len(rows)} packages"
    return 0, f"{known} of {len(rows)} packages audited: nothing known"


def _line(row: dict[str, Any], hole: dict[str, Any]) -> str:
    fixed = ", ".join(hole.get("fix_versions", ())) or "no version yet"
    return f"{row['name']} {row.get('version', '')}: {hole['id']}, fixed in {fixed}"


if __name__ == "__main__":
    status, text = judged(*asked())
    print(text)
    sys.exit(status)
