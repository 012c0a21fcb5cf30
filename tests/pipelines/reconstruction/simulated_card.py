"""Prints what differs between the CPU and numba's simulator of a GPU: run with ``NUMBA_ENABLE_CUDASIM=1``.

The simulator runs kernels in Python. What they call of the CPU's compiled functions is given plain arrays, as a GPU's
compiler would give it its own: so the formulas run compiled, with numba's types.
"""

from __future__ import annotations

from numba.cuda.simulator import kernel

from pipelines.reconstruction import device
from tests.pipelines.reconstruction.both_devices import both, scenes

SIZE = 40, 30
LEFT_OUT = "one axis, 16 bits"  # its types alone take five seconds to compile


def main() -> None:
    """One line per array: scene, way, array, share of equal values, values."""
    kernel.FakeWithinKernelCUDAArray = lambda fake: fake._ary
    for scene in scenes(*SIZE):
        if scene.name != LEFT_OUT:
            for way, found in both(scene, device("cpu"), device("cuda")):
                for each in found:
                    print(scene.name, way, each.what, each.same, each.measured, sep="; ")


if __name__ == "__main__":
    main()
