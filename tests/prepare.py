"""`python -m tests.prepare`: fills the caches that tests share, before tests run in several processes.

Compiled kernels and thumbnails of every method, and the exemplars of the style library. On a machine that has none,
tests that start together would wait a minute for them, longer than many of them allow. Where all are there, it ends at
once.
"""

from __future__ import annotations

import multiprocessing
import os
import sys
from concurrent.futures import ProcessPoolExecutor

from pipeline.method_names import BUILT_IN
from pipeline.methods import method
from service.methods.thumbnail import thumbnail
from service.page_pictures import folder
from service.styles.exemplars import exemplars
from service.styles.library import paint_exemplar
from tests.regression.cases import CASES
from tests.regression.digests import render
from workers.execution.warm_up import warm_up

_DONE = "tests-are-prepared"
"""Name of a file beside the exemplars, in a folder of this version of the program."""


def main() -> int:
    """Prepare every method and exemplar, on all processors."""
    done = folder() / _DONE
    if not done.exists():
        with ProcessPoolExecutor(os.cpu_count(), multiprocessing.get_context("spawn")) as processes:
            work = [processes.submit(_kernels, name) for name in BUILT_IN]
            work += [processes.submit(_exemplar, name) for name in exemplars()]
            for each in work:
                each.result()
        done.touch()
    return 0


def _kernels(name: str) -> None:
    """Compile what the method needs: as a live session, and in the first recorded case of each clip."""
    chosen = method(name)
    thumbnail(name)
    warm_up(chosen, chosen.Params())
    for case in {case.clip: case for case in reversed(CASES.values()) if case.method == name}.values():
        render(case)


def _exemplar(name: str) -> None:
    for what in ("painting", "source"):
        paint_exemplar(exemplars()[name], what)


if __name__ == "__main__":
    sys.exit(main())
