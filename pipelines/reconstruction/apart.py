"""Loads and stores of compiled loops that the compiler may take as apart, so that it can use vector instructions.

LLVM turns a loop into vector instructions only if it can prove that what is written is not read again as input. Where
it cannot, it compares addresses before the loop, and gives up where that would take more than eight comparisons: a
loop that reads ten frames is one of those. `read` and `write` tell it by scoped-noalias metadata.
"""

from __future__ import annotations

from typing import Any

from numba.core import types
from numba.extending import intrinsic

__all__ = ["read", "write"]


def _scope(module: Any) -> Any:
    return module.add_metadata([module.add_metadata(["what is read", module.add_metadata(["microrelief"])])])


@intrinsic
def read(_context, array, index):  # type: ignore[no-untyped-def]  # numba's types, not ours
    """Give ``array[index]`` of a 1D array that `write` does not touch in this loop; no negative index."""

    def emit(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        data = context.make_array(signature.args[0])(context, builder, arguments[0]).data
        value = builder.load(builder.gep(data, [arguments[1]]))
        value.set_metadata("alias.scope", _scope(builder.module))
        return value

    return array.dtype(array, types.intp), emit


@intrinsic
def write(_context, array, index, value):  # type: ignore[no-untyped-def]  # numba's types, not ours
    """Set ``array[index]`` of a 1D array that `read` does not look at in this loop; no negative index."""

    def emit(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        data = context.make_array(signature.args[0])(context, builder, arguments[0]).data
        stored = builder.store(arguments[2], builder.gep(data, [arguments[1]]))
        stored.set_metadata("noalias", _scope(builder.module))
        return context.get_dummy_value()

    return types.void(array, types.intp, array.dtype), emit
