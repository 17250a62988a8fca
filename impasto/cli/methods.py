"""`impasto methods`: lists the methods and their parameters."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Annotated

import typer
from rich.padding import Padding
from rich.text import Text

from impasto.cli.console import emit, out, print_table, table
from impasto.cli.options import JsonFlag
from pipeline.method_names import DEFAULT
from workers.contract.request import Json

if TYPE_CHECKING:
    from pipeline.methods.base import Method

EPILOG = f"""[bold]Examples[/bold]

impasto methods

impasto methods {DEFAULT}

impasto methods --json | jq '.[].name'
"""


def methods(
    name: Annotated[str | None, typer.Argument(metavar="[NAME]", help="A method: list all its parameters.")] = None,
    as_json: JsonFlag = False,
) -> None:
    """List the methods, or explain one: every parameter with unit, range, default and the paper's symbol."""
    from pipeline.methods import method
    from pipeline.methods import methods as registry

    if name is not None:
        chosen = method(name)
        emit(describe(chosen)) if as_json else _teach(chosen)
    elif as_json:
        emit([describe(each) for each in registry().values()])
    else:
        _list(list(registry().values()))


def describe(chosen: Method) -> Json:
    """A method as JSON: name, title, summary, paper, inputs, parameters, steps, artefacts, passes, examples."""
    return {
        "name": chosen.name,
        "title": chosen.title,
        "summary": chosen.summary,
        "paper": chosen.paper,
        "inputs": [
            {"name": spec.name, "kind": spec.kind, "required": spec.required, "title": spec.title, "help": spec.help}
            for spec in chosen.inputs
        ],
        "params": parameters(chosen),
        "steps": [{"name": step.name, "title": step.title} for step in chosen.steps],
        "artefacts": list(chosen.artefacts),
        "makes_passes": [dataclasses.asdict(made) for made in chosen.makes_passes],
        "examples": [{"name": each.name, "title": each.title, "params": each.params} for each in chosen.examples],
    }


def parameters(chosen: Method) -> list[Json]:
    """One row per parameter: name, type, unit, range, default, symbol, group, when it applies (empty: always), help;
    and whether it may have values over time."""
    schema = chosen.Params.model_json_schema()
    kinds = schema.get("$defs", {})
    return [_parameter(name, _resolved(field, kinds)) for name, field in schema["properties"].items()]


def _resolved(field: Json, kinds: Json) -> Json:
    """A property with its references (an enum, an optional value) resolved."""
    options = [option for option in field.get("anyOf", [field]) if option.get("type") != "null"]
    first = options[0] if options else {}
    referred = kinds.get(str(first.get("$ref", "")).rpartition("/")[2], {})
    return {**referred, **first, **field}


def _parameter(name: str, field: Json) -> Json:
    from pipeline.methods.applies import When, in_words

    return {
        "name": name,
        "type": "choice" if "enum" in field else "number" if "varies" in field else field.get("type", "value"),
        "varies": field.get("varies", False),
        "unit": field.get("unit", ""),
        "range": _range(field),
        "default": field.get("default"),
        "symbol": field.get("symbol", ""),
        "group": field.get("group", ""),
        "applies": in_words(tuple(When(**one) for one in field.get("applies_when", ()))),
        "help": field.get("description", ""),
    }


def _range(field: Json) -> str:
    """Allowed values as text: "0 to 50", "more than 0", "off, on"."""
    if "enum" in field:
        return ", ".join(str(value) for value in field["enum"])
    if "maxItems" in field and "varies" not in field:
        return f"at most {field['maxItems']} of {field['items']['pattern']}"
    low, above = field.get("minimum"), field.get("exclusiveMinimum")
    high, below = field.get("maximum"), field.get("exclusiveMaximum")
    start = f"{low:g}" if low is not None else f"more than {above:g}" if above is not None else ""
    stop = f"{high:g}" if high is not None else f"less than {below:g}" if below is not None else ""
    if start and stop:
        return f"{start} to {stop}"
    return start + " or more" if low is not None else start or (f"at most {stop}" if high is not None else stop)


def _list(found: list[Method]) -> None:
    rows = table("method", "what it does")
    for each in found:
        rows.add_row(each.name, f"{each.title}. {each.summary}")
    print_table(rows)
    out.print("[dim]`impasto methods NAME` explains every parameter.")


def _teach(chosen: Method) -> None:
    out.print(f"[bold]{chosen.name}[/bold]: {chosen.title}")
    out.print(chosen.summary, markup=False)
    out.print(f"[dim]paper: {chosen.paper}; steps: {', '.join(step.name for step in chosen.steps)}")
    _section("Inputs")
    for spec in chosen.inputs:
        require_extra = "needed" if spec.required else "optional"
        out.print(Text.assemble((f"  {spec.name}", "bold"), (f"  {spec.kind}, {require_extra}", "dim")))
        _indented(spec.help)
    _section("Parameters (--param NAME=VALUE)")
    group = ""
    for row in parameters(chosen):
        if row["group"] != group:
            group = row["group"]
            out.print(Text(f"  {group}", "magenta"))
        _teach_parameter(row)
    if chosen.artefacts:
        _section(f"Artefacts (--artefact NAME): {', '.join(chosen.artefacts)}")
    if chosen.makes_passes:
        _section("Passes (--passes NAME,...)")
    for made in chosen.makes_passes:
        channels = ", ".join(made.channels) + (f"; {made.unit}" if made.unit else "")
        out.print(Text.assemble((f"  {made.name}", "bold"), (f"  {channels}", "dim")))
        _indented(made.help)
    for example in chosen.examples:
        _section(f"Example: {example.title}")
        given = "".join(f" --param {name}={value}" for name, value in example.params.items())
        out.print(f"  impasto render clip.mp4 -o {example.name}.mp4 --method {chosen.name}{given}", markup=False)


def _section(title: str) -> None:
    out.print()
    out.print(Text(title, "bold"))


def _teach_parameter(row: Json) -> None:
    facts = [f"default {_shown(row['default'])}", row["range"] or row["type"]]
    facts += ["may vary over time"] if row["varies"] else []
    facts += [row["unit"]] if row["unit"] else []
    facts += [f"{row['symbol']} in the paper"] if row["symbol"] else []
    out.print(Text.assemble((f"  {row['name']}", "bold"), ("  " + "; ".join(facts), "dim")))
    _indented(row["help"] + (f" Applies only {row['applies']}." if row["applies"] else ""))


def _indented(text: str) -> None:
    if text:
        out.print(Padding(Text(text), (0, 2, 0, 6)), soft_wrap=False)


def _shown(value: object) -> str:
    return "none" if value is None else "on" if value is True else "off" if value is False else str(value)
