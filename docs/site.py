"""Builds the documentation as a searchable site: `python -m docs.site FOLDER`, or `make docs`.

Sphinx with MyST builds it from the repository's Markdown files, unchanged, the docstrings of the package `impasto`, and
the OpenAPI document. Its output is not committed.
"""

from __future__ import annotations

import gc
import re
import shutil
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from sphinx.application import Sphinx

from docs.http_reference import http_reference
from docs.measurement_pages import PAGES as MEASURED

ROOT = Path(__file__).resolve().parents[1]
PAGES = ("README.md", "DESIGN.md", "CONTRIBUTING.md", "CHANGELOG.md")
FOLDERS = ("docs", "examples", "deploy")
LINKED = (
    "LICENSE",
    "NOTICE",
    "client/README.md",
    "integrations/blender/README.md",
    "integrations/comfyui/README.md",
    "impasto/live/client.py",
    "tests/regression/README.md",
)
"""Single files that pages link to."""
WRITTEN = sorted({page.stem for page in (ROOT / "docs/measurements").glob("*.md")} - {"README", *MEASURED})
"""Pages of measurements that are not drawn from tables."""
CHAPTERS: dict[str, tuple[str, ...]] = {
    "Start": (
        "README",
        *(f"docs/tutorials/{name}" for name in ("shot", "film", "painter", "streamer", "pipeline", "researcher")),
    ),
    "Methods": tuple(
        f"docs/{name}"
        for name in ("methods", "abstraction", "multistyle", "patches", "analogy", "steady", "method-passes", "gallery")
    ),
    "Use": (
        *(
            f"docs/{name}"
            for name in ("studio", "projects", "groups", "batch", "live", "quality", "api", "http", "python")
        ),
        "client/README",
        "integrations/blender/README",
        "integrations/comfyui/README",
    ),
    "Operate": tuple(
        f"docs/{name}"
        for name in ("operations", "systems", "users", "scale", "runbook", "security", "licences", "performance")
    ),
    "Measurements": tuple(f"docs/measurements/{name}" for name in ("README", *MEASURED, *WRITTEN)),
    "Develop": ("docs/architecture", "docs/testing", "docs/glossary", "DESIGN", "CONTRIBUTING", "CHANGELOG"),
}
PYTHON = """\
# The Python package

```{eval-rst}
.. autofunction:: impasto.library.render

.. autoclass:: impasto_client.Client
   :members:

.. autoclass:: impasto.live.client.LiveClient
   :members:
```
"""
_FILE = re.compile(r'<(?:img|a|source|video)\b[^>]*?(?:src|href)="([^":#?]+)"')
SETTINGS: dict[str, object] = {
    "project": "Impasto",
    "extensions": ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"],
    "html_theme": "furo",
    "html_title": "Impasto",
    "html_copy_source": False,
    "html_show_copyright": False,
    "myst_heading_anchors": 5,
    "autodoc_typehints": "description",
    "suppress_warnings": ["myst.header", "misc.highlighting_failure", "toc.not_included"],
}


def build(out: Path) -> int:
    """Write the site to `out`, which is created. Returns the number of Sphinx's warnings, which go to stderr."""
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "source"
        collect(source)
        app = Sphinx(
            str(source), None, str(out), str(Path(folder) / "trees"), "html", confoverrides=SETTINGS, status=None
        )
        gc.disable()  # a quarter of the time would be a search for garbage among the trees of pages
        try:
            app.build()
        finally:
            gc.enable()
        _copy_files_of_html(source, out)
        return int(app._warncount)


def collect(source: Path) -> None:
    """Copy everything that pages show or link to, and write the pages that are generated from code."""
    source.mkdir(parents=True)
    for name in (*PAGES, *LINKED):
        (source / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / name, source / name)
    for name in FOLDERS:
        shutil.copytree(ROOT / name, source / name, ignore=shutil.ignore_patterns("__pycache__", "secrets", "targets"))
    (source / "index.md").write_text("\n".join(_index()))
    (source / "docs" / "python.md").write_text(PYTHON)
    (source / "docs" / "http.md").write_text(http_reference())


def _copy_files_of_html(source: Path, out: Path) -> None:
    """Copy the files that HTML within the pages references; Sphinx copies only those of Markdown."""
    for page in source.rglob("*.md"):
        for link in _FILE.findall(page.read_text()):
            file = page.parent / link
            if file.is_file() and file.suffix != ".md":
                target = out / file.relative_to(source)
                target.parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(file, target)


def _index() -> Iterator[str]:
    yield "# Impasto\n\nImpasto turns video into paintings and cartoons that hold still where they should.\n"
    for chapter, pages in CHAPTERS.items():
        yield f"```{{toctree}}\n:caption: {chapter}\n:maxdepth: 1\n"
        yield from pages
        yield "```\n"


if __name__ == "__main__":
    target = Path(sys.argv[1] if len(sys.argv) > 1 else "build/site")
    warnings = build(target)
    print(f"{target / 'index.html'}, {warnings} warnings")
    sys.exit(bool(warnings))
