"""Generates tables of methods and parameters from the registry and the schemas, so that they match the code.

`python -m docs.parameters` writes docs/methods.md (`--print` prints it). The pages of single methods take `table` and
`section` from here.
"""

from __future__ import annotations

import itertools
import sys
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from pipeline.methods import methods
from pipeline.methods.abstraction import AbstractionParams
from pipeline.methods.applies import When, in_words
from pipeline.methods.base import Method

PAGE = Path(__file__).resolve().parent / "abstraction.md"
METHODS_PAGE = PAGE.with_name("methods.md")
BEGIN, END = "<!-- parameters: written by docs/make_abstraction_figures.py -->", "<!-- end of parameters -->"
OVER_TIME = """\
## Values over time

A number of this list may have values over time instead of one for the whole film: `[[frame, value], ...]`, with the
film's frame numbers, from 0, in increasing order; for example `{"vividness": [[0, 0.2], [48, 0.9]]}`. The value is
linear between two keys, and constant before the first and after the last one. The HTTP API, the library and layers of
projects take this list; `--param vividness=0:0.2,48:0.9` of the command is the same. The studio sets keys at the
shown frame (the diamond beside the parameter's name). A piece of a film has the values that its frames have in the
film. Methods with a memory, such as `steady`, follow a sudden change within some frames. A live stream refuses a
list: its frames have no numbers of a film.
"""
SYMBOLS = {"sigma_e": "σₑ", "epsilon": "ε", "phi_e": "φₑ", "lambda": "λ", "T_f": "T_f", "N(h)": "N(h)"}


def section(captions: Mapping[str, str]) -> str:
    """All parameters by group: a table, then a figure of each parameter's effect.

    Args:
        captions: caption of each parameter's figure.
    """
    properties: Mapping[str, Mapping[str, Any]] = AbstractionParams.model_json_schema()["properties"]
    lines: list[str] = []
    for group, members in itertools.groupby(properties.items(), key=lambda item: item[1]["group"]):
        chosen = dict(members)
        lines += [f"### {group}", "", *table(chosen), "", *_pictures(chosen, captions)]
    return "\n".join(lines)


def table(properties: Mapping[str, Mapping[str, Any]]) -> Iterator[str]:
    """Parameters as rows: description, unit, range, default, the paper's symbol."""
    yield "| parameter | what it does | unit | range | default | in the paper |"
    yield "|---|---|---|---|---|---|"
    for name, field in properties.items():
        symbol = SYMBOLS.get(field.get("symbol", ""), field.get("symbol", ""))
        cells = [
            f"**{field['title']}**<br>`{name}`",
            (field["description"] + _condition(field)).replace("|", "\\|"),
            field.get("unit", ""),
            _range(field),
        ]
        yield "| " + " | ".join([*cells, f"{_value(field['default'])}", symbol]) + " |"


def _condition(field: Mapping[str, Any]) -> str:
    """Sentences: whether a parameter may vary, and the conditions under which it has an effect."""
    when = tuple(When(**one) for one in field.get("applies_when", ()))
    over_time = " May have values over time." if "varies" in field else ""
    return over_time + (f" Applies only {in_words(when)}." if when else "")


def _range(field: Mapping[str, Any]) -> str:
    if "enum" in field:
        return ", ".join(f"`{value}`" for value in field["enum"])
    if "pattern" in field:
        return "#000000 to #ffffff"
    if field.get("type") == "array":
        return f"up to {field['maxItems']} colours"
    return f"{_value(field['minimum'])} to {_value(field['maximum'])}"


def _value(value: object) -> str:
    if isinstance(value, list):
        return ", ".join(map(str, value)) or "none"
    return f"{value:.3g}" if isinstance(value, float) else f"{value}"


def _pictures(properties: Mapping[str, Mapping[str, Any]], captions: Mapping[str, str]) -> Iterator[str]:
    for name, field in properties.items():
        if name not in captions:  # it changes no frame of a whole film
            continue
        yield f"**{field['title']}**, `{name}`: {captions[name]}"
        yield ""
        yield f"![What {field['title'].lower()} does](abstraction/{name}.jpg)"
        yield ""


def rewrite(captions: Mapping[str, str]) -> None:
    """Write the section between its markers in docs/abstraction.md."""
    before, _, rest = PAGE.read_text().partition(BEGIN)
    _, _, after = rest.partition(END)
    PAGE.write_text(f"{before}{BEGIN}\n\n{section(captions)}\n{END}{after}")


def methods_page(found: Iterable[Method]) -> str:
    """A page that lists methods with all their inputs. The methods' own pages list the parameters."""
    listed = list(found)
    lines = ["# Methods", "", "Written by `python -m docs.parameters` from the registry.", "", *methods_table(listed)]
    lines += ["", OVER_TIME]
    lines += [
        f"- `{method.name}`: {', '.join(f'`{name}`' for name in method.Params.varying())}"
        for method in listed if method.Params.varying()
    ]  # fmt: skip
    for method in listed:
        lines += ["", f"## {method.title}: `{method.name}`", "", method.summary, "", *_inputs(method)]
        lines += ["", "[Passes](method-passes.md):", "", *_passes(method)] if method.makes_passes else []
    return "\n".join(lines) + "\n"


def methods_table(found: Iterable[Method]) -> Iterator[str]:
    """Methods as rows: name, description, inputs besides the video, artefacts, the paper's key in references.bib."""
    yield "| method | what it does | further inputs | artefacts | paper |"
    yield "|---|---|---|---|---|"
    for method in found:
        further = ", ".join(f"`{spec.name}`" for spec in method.inputs[1:])
        artefacts = ", ".join(f"`{name}`" for name in method.artefacts)
        yield f"| `{method.name}` | {method.summary} | {further} | {artefacts} | {method.paper} |"


def _inputs(method: Method) -> Iterator[str]:
    yield "| input | kind | required | what it is |"
    yield "|---|---|---|---|"
    for spec in method.inputs:
        required = "yes" if spec.required else "no"
        only = f" Applies only {in_words(spec.applies_when)}." if spec.applies_when else ""
        yield f"| `{spec.name}` | {spec.kind} | {required} | {(spec.help + only).replace('|', '&#124;')} |"


def _passes(method: Method) -> Iterator[str]:
    yield "| pass | channels | what it is | in PNG |"
    yield "|---|---|---|---|"
    for made in method.makes_passes:
        when = method.passes_when.get(made.name, ())
        only = f" Made only {in_words(when)}." if when else ""
        unit = f" Unit: {made.unit}." if made.unit else ""
        stored = "65536 G + R" if made.ids else f"{made.png_zero:g} + {made.png_scale:g} v" if made.png_zero else ""
        cells = (f"`{made.name}`", ", ".join(made.channels), made.help + unit + only, stored or f"{made.png_scale:g} v")
        yield "| " + " | ".join(cells) + " |"


if __name__ == "__main__":
    page = methods_page(methods().values())
    print(page) if "--print" in sys.argv else METHODS_PAGE.write_text(page)
