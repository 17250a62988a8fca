"""Writes the studio's help page, service/docs/shot.html, from docs/tutorials/shot.md: `python -m docs.make_help_page`.

The page has no pictures, because its readers have the studio in front of them.
"""

from __future__ import annotations

import re
from pathlib import Path

from markdown_it import MarkdownIt

ROOT = Path(__file__).resolve().parents[1]
SOURCE = ROOT / "docs" / "tutorials" / "shot.md"
PAGE = ROOT / "service" / "docs" / "shot.html"
FRAME = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title} · Impasto</title>
<link rel="icon" href="/static/img/favicon.svg" type="image/svg+xml">
<link rel="stylesheet" href="/docs/docs.css">
</head>
<body class="guide">
<p><a href="/">To the studio</a></p>
<main>
{content}</main>
</body>
</html>
"""


def page() -> str:
    """The HTML of the tutorial, without pictures and links to files of the repository."""
    text = SOURCE.read_text()
    title = text.partition("\n")[0].removeprefix("# ")
    text = re.sub(r"^!\[[^\]]*\]\([^)]*\)\n+", "", text, flags=re.MULTILINE)
    text = re.sub(r"\[([^\]]+)\]\((?!https?:)[^)]*\)", r"\1", text)
    return FRAME.format(title=title, content=MarkdownIt().render(text))


def main() -> None:
    PAGE.write_text(page())


if __name__ == "__main__":
    main()
