"""The card: how kernels are made and started, and what is brought there."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable
from functools import partial
from types import FunctionType
from typing import Any

import numba
import numpy as np
import numpy.typing as npt
from numba import cuda
from numba.core.dispatcher import Dispatcher

from ...slabs import in_slabs

__all__ = [
    "SIMULATED",
    "OnCard",
    "cached",
    "clear",
    "empty",
    "kernel",
    "launch",
    "pixelwise",
    "up",
    "up_quickly",
]

THREADS = 128
KEPT = 12  # tables of calibrations and patterns that stay on the card
SIMULATED = bool(numba.config.ENABLE_CUDASIM)
"""Whether numba's simulator stands in for a card: in Python, one thread after another."""

OnCard = Any
"""An array on the card: shape, dtype and views like numpy's."""

numba.config.CUDA_LOW_OCCUPANCY_WARNINGS = 0  # some kernels are small: that is no fault


def _without_fusing() -> None:
    """Have products and sums rounded one by one, as on the CPU.

    NVVM fuses them by default, and numba has no option against it. A last digit more or less would turn thresholds,
    and a cell that is measured on one of the two devices would be missing on the other.
    """
    from numba.cuda.cudadrv import nvvm

    nvvm.compile_ir = partial(nvvm.compile_ir, fma=False)


def _with_roots() -> None:
    """Give the target numpy's root and roundings: numba-cuda knows their types and lacks their code."""
    from numba.cuda import ufuncs

    for function, name in ((np.sqrt, "sqrt"), (np.floor, "floor"), (np.rint, "rint")):
        code = {"f->f": partial(_call, f"__nv_{name}f"), "d->d": partial(_call, f"__nv_{name}")}
        ufuncs.ufunc_db().setdefault(function, code)


def _call(name, _context, builder, _signature, args):  # type: ignore[no-untyped-def]  # numba's types, not ours
    """Emit a call of a function of CUDA's own library."""
    from llvmlite import ir

    known = builder.module.globals.get(name)
    kind = ir.FunctionType(args[0].type, [args[0].type])
    return builder.call(known or ir.Function(builder.module, kind, name), args)


if not SIMULATED:
    _without_fusing()
    _with_roots()


def kernel(function: Callable[..., None]) -> Any:
    """Make a kernel. Its machine code is kept beside the file, as that of the CPU's functions is.

    A kernel is kept by the file that it stands in: after a change to a formula of the CPU, touch the file or clear
    ``NUMBA_CACHE_DIR``. Linking must not optimise again: it would fuse what was not to be fused.
    """
    return cuda.jit(function) if SIMULATED else cuda.jit(function, cache=True, lto=False)


def launch(made: Any, size: int, *given: Any) -> None:
    """Start a kernel with about a thread for each of `size`; it takes steps of ``cuda.gridsize(1)``."""
    if size > 0:
        made[(1, 1) if SIMULATED else (-(-size // THREADS), THREADS)](*given)


def pixelwise(function: Any, **constants: int) -> Any:
    """Compile a CPU's loop over blocks of pixels once more, with other constants: a block of one pixel.

    The functions that it calls are compiled with the same constants.
    """
    scope = dict(function.py_func.__globals__)
    scope.update({name: value for name, value in constants.items() if name in scope})
    for name in function.py_func.__code__.co_names:
        if isinstance(scope.get(name), Dispatcher):
            scope[name] = pixelwise(scope[name], **constants)
    copy = FunctionType(function.py_func.__code__, scope, function.py_func.__name__)
    copy.__module__ = f"{__name__}.{function.py_func.__name__}"
    return numba.njit(nogil=True, error_model="numpy")(copy)


def up(array: npt.NDArray[Any]) -> OnCard:
    """Bring an array to the card."""
    return cuda.to_device(np.ascontiguousarray(array))


def up_quickly(stack: npt.NDArray[Any]) -> OnCard:
    """Bring frames to the card by way of page-locked memory, which several threads fill; as `up`, in half the time.

    The memory is kept for the next capture. Who comes while another thread holds it gets his own.
    """
    if SIMULATED:
        return up(stack)
    key = stack.shape, stack.dtype.str
    room = _rooms.pop(key, None)
    if room is None:
        _rooms.clear()
        room = cuda.pinned_array(stack.shape, stack.dtype)

    def copy(first: int, last: int) -> None:
        room[first:last] = stack[first:last]

    in_slabs(len(stack), copy, step=1, least=1)
    brought = cuda.to_device(room)
    _rooms[key] = room
    return brought


_rooms: dict[tuple[Any, str], Any] = {}


def empty(shape: tuple[int, ...] | int, dtype: npt.DTypeLike) -> OnCard:
    """Make room on the card; what it holds is left from before."""
    return cuda.device_array(shape, dtype)


@kernel
def _clear(array):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    for n in range(cuda.grid(1), array.size, cuda.gridsize(1)):
        array[n] = 0


def clear(size: int, dtype: npt.DTypeLike) -> OnCard:
    """Make room of zeros, in one dimension."""
    array = empty(size, dtype)
    launch(_clear, size, array)
    return array


_cache: OrderedDict[Hashable, Any] = OrderedDict()


def cached(key: Hashable, make: Callable[[], Any]) -> Any:
    """What was made for a key before; the last few are kept."""
    held = _cache.pop(key, None)
    if held is None:
        held = make()
    _cache[key] = held
    while len(_cache) > KEPT:
        _cache.popitem(last=False)
    return held
