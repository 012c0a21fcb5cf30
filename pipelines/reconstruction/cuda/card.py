"""The card: how kernels are made and started, and what is brought there."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from functools import partial
from importlib.util import find_spec
from types import FunctionType
from typing import Any

import numba
import numpy as np
import numpy.typing as npt
from numba import cuda
from numba.core.dispatcher import Dispatcher

__all__ = ["THREADS", "OnCard", "cached", "clear", "empty", "kernel", "launch", "missing", "pixelwise", "up"]

THREADS = 128
KEPT = 3  # calibrations whose tables stay on the card
SIMULATED = bool(numba.config.ENABLE_CUDASIM)
"""Whether numba's simulator stands in for a card: in Python, one thread after another."""

OnCard = Any
"""An array on the card: shape, dtype and views like numpy's."""

numba.config.CUDA_LOW_OCCUPANCY_WARNINGS = 0  # some kernels are small: that is no fault


def missing() -> str:
    """Why there is no card to work on, and what to do; empty if there is one."""
    if cuda.is_available():
        return ""
    if find_spec("numba_cuda") is None:
        return "the extra is not installed: pip install 'microrelief[cuda]'"
    return "no NVIDIA GPU and driver are found on this machine (`nvidia-smi` lists what there is)"


def _without_fusing() -> None:
    """Have products and sums rounded one by one, as on the CPU.

    NVVM fuses them by default, and numba has no option against it. A last digit more or less would turn thresholds,
    and a cell that is measured on one of the two devices would be missing on the other.
    """
    from numba.cuda.cudadrv import nvvm

    nvvm.compile_ir = partial(nvvm.compile_ir, fma=False)


if not SIMULATED:
    _without_fusing()


def kernel(function: Callable[..., None]) -> Any:
    """Make a kernel. Its machine code is kept beside the file, as that of the CPU's functions is."""
    return cuda.jit(cache=not SIMULATED)(function)


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


_cache: OrderedDict[str, Any] = OrderedDict()


def cached(key: str, make: Callable[[], Any]) -> Any:
    """What was made for a key (a calibration's id) before; the last few are kept."""
    if key not in _cache:
        _cache[key] = make()
        while len(_cache) > KEPT:
            _cache.popitem(last=False)
    _cache.move_to_end(key)
    return _cache[key]
