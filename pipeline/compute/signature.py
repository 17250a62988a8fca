"""Signatures of OpenCL kernels: parameters with declared sizes, parsed from the source and checked at each launch.

Every pointer parameter of a kernel declares its minimum number of elements in a comment after its name:

    kernel void blur(global const float *image /* height * width */, const int width, const int height)

The expression may use the kernel's scalar parameters, the fields of structs passed by value, the compile-time macros,
X, Y, Z (the numbers of work items before rounding) and NAME_length (the number of elements of another array). OpenCL
itself does not check sizes: kernels read and write beyond the end of a buffer that is too small.
"""

from __future__ import annotations

import ast
import operator
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Protocol, TypeAlias

import numpy as np

from pipeline.errors import DeviceError

Macro: TypeAlias = int | float | str
"""Value of a macro of the source (`-D name=value`)."""
SizeOf: TypeAlias = Callable[[Mapping[str, Macro]], int]
"""Computes a size expression from the values of its names."""


class Sized(Protocol):
    """An array in device memory."""

    @property
    def nbytes(self) -> int: ...


_ELEMENT_BYTES = {
    "uchar": 1,
    "char": 1,
    "short": 2,
    "ushort": 2,
    "int": 4,
    "uint": 4,
    "float": 4,
    "long": 8,
    "ulong": 8,
}
_NUMBERS = (int, float, np.generic)
_LANES = {3: 4}
"""Lanes that a vector occupies in memory, where this differs from its length: a vector of three occupies four."""


@dataclass(frozen=True)
class Parameter:
    """A kernel parameter. `size` gives the size of a pointer, in elements; None for a parameter by value."""

    name: str
    element_bytes: int = 0
    size: SizeOf | None = None
    text: str = ""


@cache
def signature(source: str, name: str) -> tuple[Parameter, ...]:
    """The parameters of the kernel `name`.

    Raises:
        DeviceError: the source has no such kernel, or a pointer has no declared size, or none that can be computed.
    """
    found = re.search(rf"kernel\s+void\s+{name}\s*\(", source)
    if found is None:
        raise DeviceError(f"The source has no kernel {name}.", field="kernel", value=name, remedy="Correct the name.")
    return tuple(_parameter(text, name) for text in _split(source, found.end()))


def _split(source: str, start: int) -> list[str]:
    """Split a parameter list into its parameters; ignores commas and parentheses inside comments."""
    parts, depth, begin, at = [], 1, start, start
    while depth:
        if source.startswith("/*", at):
            at = source.index("*/", at) + 1
        elif source[at] == "(":
            depth += 1
        elif source[at] == ")":
            depth -= 1
        if depth == 0 or (source[at] == "," and depth == 1):
            parts.append(source[begin:at].strip())
            begin = at + 1
        at += 1
    return parts


def _parameter(text: str, kernel: str) -> Parameter:
    declaration, _, comment = text.partition("/*")
    name = re.findall(r"\w+", declaration)[-1]
    if "*" not in declaration:
        return Parameter(name)
    kind = re.search(r"\b(u?(?:char|short|int|long)|float)(\d*)\s*\*", declaration)
    expression = " ".join(comment.partition("*/")[0].split())
    if kind is None or not expression:
        raise DeviceError(
            f"The parameter {name} of the kernel {kernel} declares no size.", field="kernel", value=kernel,
            remedy=f"Write the number of elements behind its name: {name} /* height * width */.",
        )  # fmt: skip
    lanes = int(kind[2] or 1)
    return Parameter(name, _ELEMENT_BYTES[kind[1]] * _LANES.get(lanes, lanes), _compiled(expression), expression)


_OPERATORS: Mapping[type[ast.operator], Callable[[int, int], int]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.FloorDiv: operator.floordiv,
}


@cache
def _compiled(expression: str) -> SizeOf:
    """The function that computes a size expression."""
    return _function(ast.parse(expression, mode="eval").body)


def _function(node: ast.expr) -> SizeOf:
    """The function that computes a node: an integer, a name, an operator + - * //, or `or` (result 1 or 0)."""
    if isinstance(node, ast.Constant) and isinstance(node.value, int):
        value = node.value
        return lambda names: value
    if isinstance(node, ast.Name):
        name = node.id
        return lambda names: int(names[name])
    if isinstance(node, ast.BinOp) and type(node.op) in _OPERATORS:
        combined, left, right = _OPERATORS[type(node.op)], _function(node.left), _function(node.right)
        return lambda names: combined(left(names), right(names))
    if isinstance(node, ast.BoolOp) and isinstance(node.op, ast.Or):
        parts = [_function(part) for part in node.values]
        return lambda names: max(part(names) != 0 for part in parts)
    raise DeviceError(
        "The size of a kernel argument is not an arithmetic expression.", field="kernel", value=ast.unparse(node),
        remedy="Use integers, names, the operators + - * // and `or` only.",
    )  # fmt: skip


def check(
    kernel: str, parameters: Sequence[Parameter], args: Sequence[Sized | float | np.generic], size: Sequence[int],
    macros: Mapping[str, Macro],
) -> None:  # fmt: skip
    """Check that every array argument holds at least the declared number of elements.

    Args:
        args: arrays with an attribute `nbytes`, Python or NumPy numbers, and NumPy records for structs.
        size: work items along x, y, z before rounding.

    Raises:
        DeviceError: the number of arguments is wrong, or an array is too small.
    """
    if len(args) != len(parameters):
        raise DeviceError(
            f"The kernel {kernel} has {len(parameters)} parameters and got {len(args)} arguments.", field="kernel",
            value=kernel, remedy="Pass one argument for each parameter.",
        )  # fmt: skip
    names: dict[str, Macro] = {**dict(zip("XYZ", (*size, 1, 1), strict=False)), **macros}
    for parameter, value in zip(parameters, args, strict=True):
        if isinstance(value, np.void):
            names |= {field: int(value[field]) for field in value.dtype.names or ()}
        elif isinstance(value, _NUMBERS):
            names[parameter.name] = int(value)
        else:
            names[f"{parameter.name}_length"] = value.nbytes // parameter.element_bytes
    for parameter, value in zip(parameters, args, strict=True):
        if parameter.size is None:
            continue
        size_bytes = 0 if isinstance(value, int | float) else value.nbytes
        needed = parameter.size(names) * parameter.element_bytes
        if size_bytes < needed:
            raise DeviceError(
                f"The argument {parameter.name} of the kernel {kernel} has {size_bytes} bytes; its declared size "
                f"({parameter.text}) is {needed} bytes.", field="kernel", value=kernel,
                remedy="Report this: it is a fault of the program.",
            )  # fmt: skip
