"""Builds the browser bundle before the Python files are collected; everything else is in pyproject.toml."""

from __future__ import annotations

import sys
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py

sys.path.insert(0, str(Path(__file__).resolve().parent))

from service import bundle


class BuildWithPages(build_py):
    """`build_py`, which every wheel and every editable installation runs, after the bundle was built."""

    def run(self) -> None:
        bundle.build()
        super().run()


setup(cmdclass={"build_py": BuildWithPages})
