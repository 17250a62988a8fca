"""The parameters' part of docs/abstraction.md, from the schema, so that it cannot drift."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from pipeline.methods.abstraction import AbstractionParams

PAGE = Path(__file__).resolve().parent / "abstraction.md"
BEGIN, END = "<!-- parameters: written by docs/make_abstraction_figures.py -->", "<!-- end of parameters -->"
SYMBOLS = {"sigma_e": "σₑ", "epsilon": "ε", "phi_e": "φₑ", "lambda": "λ", "T_f": "T_f", "N(h)": "N(h)"}


def section(captions: Mapping[str, str]) -> str:
    """Every parameter by group: a table, then a picture of each one's effect.

    Args:
        captions: by parameter, what its picture shows.
    """
    properties: Mapping[str, Mapping[str, Any]] = AbstractionParams.model_json_schema()["properties"]
    lines: list[str] = []
    for group, members in itertools.groupby(properties.items(), key=lambda item: item[1]["group"]):
        chosen = dict(members)
        lines += [f"### {group}", "", *table(chosen), "", *_pictures(chosen, captions)]
    return "\n".join(lines)


def table(properties: Mapping[str, Mapping[str, Any]]) -> Iterator[str]:
    """Parameters as rows: what each does, unit, range, default, the paper's symbol."""
    yield "| parameter | what it does | unit | range | default | in the paper |"
    yield "|---|---|---|---|---|---|"
    for name, about in properties.items():
        symbol = SYMBOLS.get(about.get("symbol", ""), about.get("symbol", ""))
        cells = [
            f"**{about['title']}**<br>`{name}`",
            about["description"].replace("|", "\\|"),
            about.get("unit", ""),
            _range(about),
        ]
        yield "| " + " | ".join([*cells, f"{_value(about['default'])}", symbol]) + " |"


def _range(about: Mapping[str, Any]) -> str:
    if "enum" in about:
        return ", ".join(f"`{value}`" for value in about["enum"])
    return f"{_value(about['minimum'])} to {_value(about['maximum'])}"


def _value(value: object) -> str:
    return f"{value:.3g}" if isinstance(value, float) else f"{value}"


def _pictures(properties: Mapping[str, Mapping[str, Any]], captions: Mapping[str, str]) -> Iterator[str]:
    for name, about in properties.items():
        yield f"**{about['title']}**, `{name}`: {captions[name]}"
        yield ""
        yield f"![What {about['title'].lower()} does](abstraction/{name}.jpg)"
        yield ""


def rewrite(captions: Mapping[str, str]) -> None:
    """Put the section between its marks in docs/abstraction.md."""
    before, _, rest = PAGE.read_text().partition(BEGIN)
    _, _, after = rest.partition(END)
    PAGE.write_text(f"{before}{BEGIN}\n\n{section(captions)}\n{END}{after}")
