"""Commands with a dataclass of options, and the refusal of options that nothing reads."""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Callable, Collection, Mapping
from typing import Any, TypeVar, get_type_hints

import typer

from pipeline.errors import BadInput

Options = TypeVar("Options")

GIVEN = "given"


def refuse_given(given: Mapping[str, str], names: Collection[str], why: str, remedy: str) -> None:
    """Raise BadInput if one of these options is given, because nothing reads it here."""
    for name in names:
        if name in given:
            raise BadInput(f"{given[name]} {why}", field=given[name], remedy=remedy)


def _given(context: typer.Context) -> dict[str, str]:
    """The options of the command line: name of the field, and of the option."""
    named = [(option.name or "", option.opts[0]) for option in context.command.params]
    sources = [(name, flag, context.get_parameter_source(name)) for name, flag in named]
    return {name: flag for name, flag, source in sources if source is not None and source.name == "COMMANDLINE"}


def takes_options(options: type[Options]) -> Callable[[Callable[[Options], None]], Callable[..., None]]:
    """Make a function of one dataclass a command: each field becomes an option.

    The command library reads options from a function's signature: this gives the command a signature with a parameter
    for each field, of the field's name, annotation and default, and calls the function with an instance.

    Args:
        options: a dataclass. Its annotations are those of a command's parameters (`Annotated[int, typer.Option(...)]`).
            A field `given` becomes no option: it gets the names of the fields that are given, and how to write them.
    """
    hints = get_type_hints(options, include_extras=True)
    fields = [field for field in dataclasses.fields(options) if field.name != GIVEN]  # type: ignore[arg-type]
    parameters = [_parameter(field, hints[field.name]) for field in fields]
    parameters.append(inspect.Parameter("context", inspect.Parameter.KEYWORD_ONLY, annotation=typer.Context))

    def decorate(function: Callable[[Options], None]) -> Callable[..., None]:
        def command(context: typer.Context, **values: object) -> None:
            function(options(**values, **({GIVEN: _given(context)} if GIVEN in hints else {})))

        command.__name__, command.__doc__, command.__module__ = function.__name__, function.__doc__, function.__module__
        command.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
        command.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        return command

    return decorate


def _parameter(field: dataclasses.Field[Any], hint: Any) -> inspect.Parameter:
    default = inspect.Parameter.empty if field.default is dataclasses.MISSING else field.default
    return inspect.Parameter(field.name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=hint)
