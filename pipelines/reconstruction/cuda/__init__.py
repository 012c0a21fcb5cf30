"""The way from frames to a height map on an NVIDIA GPU: the CPU's own formulas, a thread per pixel or cell.

The kernels call the compiled functions of the CPU, which numba compiles once more for the GPU: there is one formula.
Only what goes through a line or a band there is written anew here, in the same order of additions, and products are
not fused with sums, so that both give the same numbers. Importing this package needs numba's CUDA target;
`reconstruction.device` asks for it when it is wanted.
"""

from .card import missing
from .ways import reconstruct, scan_frames, to_scan

__all__ = ["missing", "reconstruct", "scan_frames", "to_scan"]
