"""A hint for the processor, in kernels: bring a place in memory into the cache before it is needed.

It pays where a kernel visits an array that is larger than the cache in an order that the processor cannot foresee. It
does not change results.
"""

from __future__ import annotations

from typing import Any

from pipeline.intrinsics import Intrinsic

_WRITE, _KEEP, _DATA = 1, 3, 1
"""Arguments of LLVM's `prefetch`: the place will be written to, is used more than once, and has no instructions."""


class Prefetch(Intrinsic):
    """`prefetch(array, index)`: bring an element of a flat array into the cache. Outside of kernels it does nothing."""

    def __call__(self, array: Any, index: Any) -> None:
        pass

    def generator(self) -> Any:
        from llvmlite import ir
        from numba.core import types

        def prefetch(_typing: Any, array: Any, index: Any) -> Any:
            def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
                data = context.make_array(signature.args[0])(context, builder, args[0]).data
                byte, number = ir.IntType(8).as_pointer(), ir.IntType(32)
                kind = ir.FunctionType(ir.VoidType(), [byte, number, number, number])
                hint = builder.module.declare_intrinsic("llvm.prefetch", [byte], kind)
                options = [ir.Constant(number, value) for value in (_WRITE, _KEEP, _DATA)]
                builder.call(hint, [builder.bitcast(builder.gep(data, [args[1]]), byte), *options])
                return context.get_dummy_value()

            return types.void(array, index), generate

        return prefetch


prefetch = Prefetch()
