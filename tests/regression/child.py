"""`python -m tests.regression.child CASE...`: renders the cases and prints their digests as JSON."""

from __future__ import annotations

import json
import sys

import cv2

from tests.regression.cases import CASES
from tests.regression.digests import clip_digests, render

if __name__ == "__main__":
    cv2.setNumThreads(1)
    found = {"clips": clip_digests()} | {name: render(CASES[name]) for name in sys.argv[1:]}
    print(json.dumps(found))
