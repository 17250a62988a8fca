"""`python -m tests.regression [--record] [PART...]`: compares renders with the recorded values, or records them anew.

Each PART selects the cases whose name contains it, for example `abstraction/` or `keyframe`; without one, all.
"""

from __future__ import annotations

import argparse
import sys

from tests.regression import values
from tests.regression.cases import CASES
from tests.regression.pinned import digests, unfit


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.regression", description=__doc__)
    parser.add_argument("--record", action="store_true", help="write new values; README.md states when that is allowed")
    parser.add_argument("parts", nargs="*", metavar="PART")
    args = parser.parse_args()
    if reason := unfit():
        sys.exit(reason)
    chosen = [name for name in CASES if not args.parts or any(part in name for part in args.parts)]
    found, recorded = digests(chosen), values.read().cases
    changed = [name for name, made in found.items() if recorded.get(name) != made]
    for name in changed:
        print(f"{name}: {', '.join(values.differences(recorded.get(name, {}), found[name]))}")
    print(f"{len(found) - len(changed)} equal, {len(changed)} different")
    if args.record:
        values.write({name: made for name, made in (recorded | found).items() if name in CASES or name == "clips"})
        return 0
    return 1 if changed else 0


if __name__ == "__main__":
    sys.exit(main())
