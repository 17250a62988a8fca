"""Functions that generate LLVM instructions in kernels, for what Numba has no expression for."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

LANES = 8
"""Numbers in a vector: those of a register of AVX, two of SSE or NEON."""


class Intrinsic(ABC):
    """A function that kernels call. A subclass has two versions of it: `__call__`, for calls outside of kernels, and
    the instructions, from `generator`.

    Numba is imported at the first use in a kernel, as in `pipeline.jit`.
    """

    @abstractmethod
    def generator(self) -> Any:
        """A function as Numba's decorator `intrinsic` takes it."""

    @cached_property
    def _numba_type_(self) -> Any:
        """The type that this has for Numba in a kernel that calls it."""
        from numba.core.registry import cpu_target
        from numba.extending import intrinsic

        instructions, known = intrinsic(self.generator()), cpu_target.typing_context
        known.refresh()  # it learns of new intrinsics here
        return known.resolve_value_type(instructions)


class Arguments:
    """The arguments of a call, as values of LLVM."""

    def __init__(self, context: Any, builder: Any, signature: Any, args: Any) -> None:
        self._context, self._builder, self._kinds, self._args = context, builder, signature.args, args

    def number(self, place: int) -> Any:
        """An integer, as one of 64 bits."""
        from numba.core import types

        return self._context.cast(self._builder, self._args[place], self._kinds[place], types.intp)

    def scalar(self, place: int) -> Any:
        """A float or a flag, as it is."""
        return self._args[place]

    def parts(self, place: int) -> list[Any]:
        """The elements of a tuple."""
        from numba.core import cgutils

        unpacked: Any = cgutils.unpack_tuple
        return list(unpacked(self._builder, self._args[place]))

    def data(self, place: int) -> Any:
        """Address of the first element of an array."""
        return self._data(self._kinds[place], self._args[place])

    def datas(self, place: int) -> list[Any]:
        """Addresses of the first elements of a tuple's arrays."""
        return [self._data(kind, array) for kind, array in zip(self._kinds[place], self.parts(place), strict=True)]

    def _data(self, kind: Any, array: Any) -> Any:
        return self._context.make_array(kind)(self._context, self._builder, array).data


class Vectors:
    """Generates instructions on vectors of `LANES` floats."""

    def __init__(self, builder: Any) -> None:
        from llvmlite import ir

        self.ir, self.build = ir, builder
        self.floats, self.numbers = ir.VectorType(ir.FloatType(), LANES), ir.VectorType(ir.IntType(32), LANES)
        self.zero, self.one = self.constant(0.0), self.constant(1.0)
        self.lanes = ir.Constant(self.numbers, list(range(LANES)))

    def constant(self, value: float) -> Any:
        return self.ir.Constant(self.floats, [value] * LANES)

    def all(self, value: Any) -> Any:
        """A vector whose elements are the value."""
        vector = self.ir.VectorType(value.type, LANES)
        none = self.ir.Constant(vector, self.ir.Undefined)
        return self.chosen(self.build.insert_element(none, value, self._number(0)), none, [0] * LANES)

    def short(self, number: Any) -> Any:
        """A vector whose elements are the integer of 64 bits, cut to 32."""
        return self.all(self.build.trunc(number, self.ir.IntType(32)))

    def plus(self, number: Any, step: int) -> Any:
        return self.build.add(number, self.ir.Constant(number.type, step))

    def chosen(self, one: Any, other: Any, places: Sequence[int]) -> Any:
        """The elements at these places of two vectors, one behind the other."""
        kind = self.ir.VectorType(self.ir.IntType(32), len(places))
        return self.build.shuffle_vector(one, other, self.ir.Constant(kind, list(places)))

    def element(self, vector: Any, place: int) -> Any:
        return self.build.extract_element(vector, self._number(place))

    def loaded(self, array: Any, index: Any, count: int = LANES) -> Any:
        """Elements of an array from an index on."""
        return self.build.load(self._address(array, index, count), align=1)

    def store(self, values: Any, array: Any, index: Any) -> None:
        self.build.store(values, self._address(array, index, values.type.count), align=1)

    def gathered(self, array: Any, indices: Any) -> Any:
        """The elements of an array of floats at a vector of indices."""
        found = self.ir.Constant(self.floats, self.ir.Undefined)
        for lane in range(LANES):
            value = self.build.load(self.build.gep(array, [self.element(indices, lane)]))
            found = self.build.insert_element(found, value, self._number(lane))
        return found

    def least(self, values: Any, limit: Any) -> Any:
        return self.build.select(self.build.fcmp_ordered("<", values, limit), values, limit)

    def most(self, values: Any, limit: Any) -> Any:
        return self.build.select(self.build.fcmp_ordered(">", values, limit), values, limit)

    def root(self, values: Any) -> Any:
        from numba.core import cgutils

        found: Any = cgutils.get_or_insert_function
        kind = self.ir.FunctionType(self.floats, [self.floats])
        return self.build.call(found(self.build.module, kind, f"llvm.sqrt.v{LANES}f32"), [values])

    def where(self, flag: Any, make: Callable[[], Any], otherwise: Any) -> Any:
        """`make()` if the flag is set, which generates instructions for that case only."""
        before = self.build.block
        with self.build.if_then(flag):
            made = make()
            inside = self.build.block
        result = self.build.phi(made.type)
        result.add_incoming(otherwise, before)
        result.add_incoming(made, inside)
        return result

    def _number(self, value: int) -> Any:
        return self.ir.Constant(self.ir.IntType(32), value)

    def _address(self, array: Any, index: Any, count: int) -> Any:
        kind = self.ir.VectorType(array.type.pointee, count)
        return self.build.bitcast(self.build.gep(array, [index]), kind.as_pointer())
