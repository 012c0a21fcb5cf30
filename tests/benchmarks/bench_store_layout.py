"""What the layout of a store was chosen by: codecs and chunks on a rough soil scan, and the bounds of a full-size scan.

``python -m tests.benchmarks.bench_store_layout`` prints the tables. CPU seconds of all threads, least of several runs:
other programs on the machine do not change them; the floor, measured in the same run, is the raw cells in one npz.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from time import perf_counter, process_time
from typing import Any

import numpy as np
import numpy.typing as npt

from pipelines import Grid, Scan, Tick
from storage import create_store
from storage.binned import read_bins
from storage.icechunk_store import IcechunkStore
from storage.layout import CELLS_OF_SCAN, FOLD
from storage.location import BRANCH, location_of
from storage.packing import STEP_MM, Packing, pack_sigmas
from storage.repository import root_of

from .bench_store import START, scratch

FULL = Grid(1440, 2560, 0.01)
NOISE_MM = 0.005
RAW_BYTES = 7
"""Of a cell: a float32 and three uint8."""


def rough_soil(grid: Grid, rng: np.random.Generator) -> npt.NDArray[np.float32]:
    """Self-affine relief, Hurst exponent 0.7, 0.3 mm standard deviation."""
    y, x = np.meshgrid(np.fft.fftfreq(grid.rows), np.fft.rfftfreq(grid.columns), indexing="ij")
    wave = np.hypot(y, x)
    wave[0, 0] = np.inf
    spectrum = np.fft.rfft2(rng.normal(size=grid.shape)) * wave**-1.7
    relief = np.fft.irfft2(spectrum, grid.shape)
    scaled: npt.NDArray[np.float32] = (0.3 * relief / relief.std()).astype(np.float32)
    return scaled


def soil_scan(number: int, base: npt.NDArray[np.float32], grid: Grid, rng: np.random.Generator) -> Scan:
    """The relief with 5 um of noise, a sigma that follows brightness, 3 % of holes in patches, grey grains."""
    slope = np.gradient(base, axis=1) / grid.pitch_mm
    texture = np.clip(120 - 60 * slope + rng.normal(0, 3, grid.shape), 1, 255).astype(np.uint8)
    hole = (slope > np.quantile(slope, 0.97)) | (rng.random(grid.shape) < 0.002)
    height = (base + rng.normal(0, NOISE_MM, grid.shape)).astype(np.float32)
    sigma = (NOISE_MM * np.sqrt(120 / np.maximum(texture, 20))).astype(np.float32)
    height[hole] = sigma[hole] = np.nan
    time = START + np.timedelta64(6 * number, "h")
    return Scan(grid, time, height, sigma, texture, np.where(hole, 255, 0).astype(np.uint8), "calibration")


def least(work: Callable[[], Any], runs: int = 5) -> tuple[float, float]:
    """Give the least CPU and wall seconds of several runs."""
    costs = []
    for _ in range(runs):
        cpu, wall = process_time(), perf_counter()
        work()
        costs.append((process_time() - cpu, perf_counter() - wall))
    return min(cpu for cpu, _ in costs), min(wall for _, wall in costs)


def codecs(scan: Scan) -> None:
    """Compare codecs on a packed scan, one chunk after another as it is stored."""
    from zarr.codecs import BloscCodec

    packed = {"height": Packing("int16").pack(scan.height, "height"), "sigma": pack_sigmas(scan.sigma, STEP_MM)}
    packed["texture"] = scan.texture
    names = " ".join(f"{name:>8}" for name in packed)
    print(f"{'codec':>24} {'block':>8} {names} bits a cell  {'write':>8} {'read':>8} CPU ms")
    for name, level, shuffle, block in (
        ("zstd", 1, "bitshuffle", 2**20),
        ("zstd", 1, "shuffle", 2**20),
        ("zstd", 1, "noshuffle", 2**20),
        ("zstd", 1, "bitshuffle", 0),
        ("zstd", 3, "bitshuffle", 2**20),
        ("lz4", 5, "bitshuffle", 2**20),
        ("lz4hc", 5, "bitshuffle", 2**20),
    ):
        codec = BloscCodec(cname=name, clevel=level, shuffle=shuffle, blocksize=block)  # type: ignore[arg-type]  # literals of zarr's
        bits, write, read = {}, 0.0, 0.0
        for key, cells in packed.items():
            stored = _in_memory(cells, (720, 854), [codec])
            write += least(lambda cells=cells, codec=codec: _in_memory(cells, (720, 854), [codec]), 2)[0]  # type: ignore[misc]  # bound now
            read += least(lambda stored=stored: stored[:], 2)[0]  # type: ignore[misc]  # bound now
            bits[key] = 8 * int(stored.nbytes_stored()) / cells.size
        marks = {"bitshuffle": "height, level", "shuffle": "sigma", "noshuffle": "texture"}
        ours = f"  <- ours, {marks[shuffle]}" if (name, level, block) == ("zstd", 1, 2**20) else ""
        told, sizes = f"{name}{level} {shuffle}", " ".join(f"{bits[key]:8.2f}" for key in packed)
        print(f"{told:>24} {block or 'auto':>8} {sizes} {write * 1e3:21.0f} {read * 1e3:8.0f}{ours}")
    print(f"{'chunk':>24} {'height':>8} bits a cell  {'write':>8} {'read':>8} CPU ms")
    best = BloscCodec(cname="zstd", clevel=1, shuffle="bitshuffle", blocksize=2**20)
    for chunk in ((128, 128), (240, 256), (480, 512), (720, 854), (1440, 2560)):
        stored = _in_memory(packed["height"], chunk, [best])
        write, _ = least(lambda chunk=chunk: _in_memory(packed["height"], chunk, [best]), 2)  # type: ignore[misc]  # bound now
        read, _ = least(lambda stored=stored: stored[:], 2)  # type: ignore[misc]  # bound now
        mark = "  <- ours" if chunk == (720, 854) else ""
        told, bits_ = f"{chunk[0]} x {chunk[1]}", 8 * int(stored.nbytes_stored()) / FULL.rows / FULL.columns
        print(f"{told:>24} {bits_:8.2f} {write * 1e3:21.0f} {read * 1e3:8.0f}{mark}")


def _in_memory(cells: npt.NDArray[Any], chunk: tuple[int, int], compressors: list[Any]) -> Any:
    import zarr

    group = zarr.create_group(zarr.storage.MemoryStore())
    array = group.create_array("a", shape=cells.shape, chunks=chunk, dtype=cells.dtype, compressors=compressors)
    array[:] = cells
    return array


def full_size(folder: Path) -> None:
    """Append, read and size of full-size scans beside the floor."""
    rng = np.random.default_rng(7)
    base = rough_soil(FULL, rng)
    scans = [soil_scan(number, base, FULL, rng) for number in range(5)]
    store = create_store(folder / "s", site="bench", grid=FULL)
    assert isinstance(store, IcechunkStore)
    left = iter(scans)

    def append() -> None:
        scan = next(left)
        store.append(Tick(scan.time, scan))

    file = folder / "floor.npz"

    def floor() -> None:
        scan = scans[0]
        raw = {"height": scan.height, "sigma": scan.texture, "texture": scan.texture, "level": scan.level}
        np.savez(file, **raw)  # type: ignore[arg-type]  # arrays by name

    def read_floor() -> None:
        with np.load(file) as raw:
            for name in raw.files:
                raw[name]

    appended, written = least(append, len(scans)), least(floor, 3)
    read, read_raw = least(lambda: store[-1]), least(read_floor, 3)
    cells = FULL.rows * FULL.columns
    sizes = {name: int(root_of(store.session)[f"scans/{name}"].nbytes_stored()) / len(scans) for name in CELLS_OF_SCAN}
    print(
        f"1440 x 2560 rough soil, {NOISE_MM * 1e3:.0f} um noise: bits a cell "
        + ", ".join(f"{name} {8 * size / cells:.2f}" for name, size in sizes.items())
    )
    part = sum(sizes.values()) / (RAW_BYTES * cells)
    print(f"  stored          {part:6.1%} of raw float32 + 3 x uint8 (bar 45 %)")
    _line("append", appended, written, "250 ms")
    _line("read of a scan", read, read_raw, "100 ms")
    store.close()


def _line(what: str, ours: tuple[float, float], floor: tuple[float, float], bar: str) -> None:
    print(
        f"  {what:<15} CPU {ours[0] * 1e3:5.0f} ms, wall {ours[1] * 1e3:5.0f} ms (bar {bar}); floor, raw npz: "
        f"CPU {floor[0] * 1e3:5.0f} ms, wall {floor[1] * 1e3:5.0f} ms"
    )


def history(folder: Path, scans: int = 1000) -> None:
    """One 8x8 cell through a thousand full-size scans: only ``/binned`` is filled, for nothing else is read."""
    store = create_store(folder / "h", site="bench", grid=FULL)
    assert isinstance(store, IcechunkStore)
    session = store.repository.writable_session(BRANCH)
    binned: Any = root_of(session, "r+")["binned"]
    rng = np.random.default_rng(3)
    folded = scans // FOLD * FOLD
    binned["time"].resize((scans,))
    for name in ("height", "dz"):
        binned[name].resize((folded, *binned[name].shape[1:]))
        for first in range(0, folded, FOLD):
            binned[name][first : first + FOLD] = rng.normal(0, 20, (FOLD, *binned[name].shape[1:])).astype(np.int16)
        for number in range(folded, scans):
            binned[f"{name}_tail"][number % FOLD] = rng.normal(0, 20, binned[name].shape[1:]).astype(np.int16)
    session.commit("filled")
    store.close()
    from storage.repository import open_repository

    def ours() -> None:  # opened anew: nothing is in memory
        seen: Any = root_of(open_repository(location_of(folder / "h")).readonly_session(BRANCH))["binned"]
        assert len(read_bins(seen, "height", np.array([100]), np.array([200]))) == scans

    np.save(folder / "column.npy", np.zeros(scans, np.int16))
    _line(f"cell x {scans}", least(ours, 3), least(lambda: np.load(folder / "column.npy"), 3), "100 ms")


def main() -> None:
    """Print the tables."""
    rng = np.random.default_rng(7)
    codecs(soil_scan(0, rough_soil(FULL, rng), FULL, rng))
    with scratch() as folder:
        full_size(folder)
        history(folder)


if __name__ == "__main__":
    main()
