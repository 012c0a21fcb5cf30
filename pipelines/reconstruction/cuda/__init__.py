"""The way from frames to a height map on an NVIDIA GPU: the CPU's own formulas, a thread per pixel or cell.

The kernels call the compiled functions of the CPU, which numba compiles once more for the GPU: there is one formula.
Only what goes through a line or a band there is written anew here, in the same order of additions, and products are
not fused with sums, so that both give the same numbers. Importing this package needs the extra `cuda`;
`reconstruction.device` does it when it is wanted.
"""

from .ways import reconstruct, scan_frames, to_scan

__all__ = ["reconstruct", "scan_frames", "to_scan"]
