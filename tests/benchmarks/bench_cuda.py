"""The same reconstruction on the CPU and on an NVIDIA GPU: what differs, and how long each step takes."""

from __future__ import annotations

import platform
import time
from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba
import numpy as np
import numpy.typing as npt

from pipelines import Calibration, Frames, Grid
from pipelines.reconstruction import Device, decode, device, footprint_grid, locate, to_scan, triangulate
from pipelines.reconstruction.cells import Cells
from pipelines.reconstruction.clean import reject_mixed
from pipelines.reconstruction.height_doubt import doubt_mm
from pipelines.reconstruction.light import read_light
from pipelines.reconstruction.shared_error import shared_mm2
from pipelines.reconstruction.subpixel import RUNS as RUNS_OF_LIGHT
from pipelines.reconstruction.surface import _usual, sharing, stripe_px
from tests.benchmarks.bench_reconstruct import COLUMNS, ROWS, capture
from tests.pipelines.reconstruction.both_devices import Difference, both, differences, scenes
from tests.pipelines.reconstruction.exact_rig import make_rig

Result = TypeVar("Result")

RUNS = 7
SMALL = 640, 400
DECODE, PLACE, POINTS = "decode, both axes", "sub-pixel, both axes", "triangulate"
MIXED, CELLS = "mixed pixels", "fill and mend cells (CPU: and clean up, lay)"


def main() -> None:
    """Print the tables; where there is no GPU, say so."""
    try:
        card, cpu = device("cuda"), device("cpu")
    except ValueError as error:
        print(f"reconstruction on a GPU: {error}")
        return
    from numba import cuda

    name = cuda.get_current_device().name
    name = name.decode() if isinstance(name, bytes) else name
    cores = numba.config.NUMBA_NUM_THREADS
    print(f"{name} beside {cores} cores of {platform.processor() or platform.machine()}, numba {numba.__version__}")
    rig = make_rig((COLUMNS, ROWS))
    frames, grid = capture(rig), footprint_grid(rig)
    print(f"42 frames of {COLUMNS}x{ROWS} ({frames.stack.nbytes / 1e6:.0f} MB), grid {grid.rows}x{grid.columns}")
    start = time.perf_counter()
    card.scan_frames(frames, rig, grid)
    print(f"  first scan of a process, with compiling or loading the kernels: {time.perf_counter() - start:.1f} s")
    _compare(frames, rig, grid, cpu, card)
    _race(frames, rig, grid, cpu, card)
    _steps(frames, rig, grid)
    print(f"other captures, {SMALL[0]}x{SMALL[1]}:")
    for scene in scenes(*SMALL):
        for way, found in both(scene, cpu, card):
            worst = min(found, key=lambda each: each.same)
            print(f"  {scene.name + ', ' + way:<50}" + _line(worst))


def _compare(frames: Frames, rig: Calibration, grid: Grid, cpu: Device, card: Device) -> None:
    codes = zip(_card_codes(frames), cast(Cells, decode(frames)).steps, strict=True)
    print("  codes (columns, rows) that are the same: " + ", ".join(f"{100 * (a == b).mean():.6f} %" for a, b in codes))
    print(f"  {'':<24}{'measured':>10}{'same bits':>12}{'other mask':>12}{'p99.99':>11}{'largest':>11}")
    points = cpu.reconstruct(frames, rig)
    found = differences(points, card.reconstruct(frames, rig))
    found += differences(cpu.scan_frames(frames, rig, grid), card.scan_frames(frames, rig, grid))
    for each in found:
        print(f"  {each.what:<24}{100 * each.measured:9.2f}%" + _line(each))


def _card_codes(frames: Frames) -> list[npt.NDArray[np.uint16]]:
    from pipelines.reconstruction.cuda import card, gray

    noise = read_light(frames, RUNS_OF_LIGHT).noise
    return [each.copy_to_host() for each in gray.decode_gray(frames, card.up(frames.stack), noise).steps]


def _line(each: Difference) -> str:
    return f"{100 * each.same:11.6f}%{each.masks:12d}{each.high:11.2g}{each.most:11.2g}"


def _race(frames: Frames, rig: Calibration, grid: Grid, cpu: Device, card: Device) -> None:
    points = cpu.reconstruct(frames, rig)
    ways: dict[str, Callable[[Device], object]] = {
        "frames to points": lambda on: on.reconstruct(frames, rig),
        "points to height map": lambda on: on.to_scan(points, rig, grid, frames.time),
        "frames to height map": lambda on: on.scan_frames(frames, rig, grid),
    }
    print(f"  {'median of ' + str(RUNS) + ', transfers included':<34}{'CPU':>11}{'2 cores':>11}{'GPU':>11}")
    for name, way in ways.items():
        whole = _median(lambda way=way: way(cpu))  # type: ignore[misc]  # a closure of this turn
        threads, numba.config.NUMBA_NUM_THREADS = numba.config.NUMBA_NUM_THREADS, 2
        two = _median(lambda way=way: way(cpu))  # type: ignore[misc]
        numba.config.NUMBA_NUM_THREADS = threads
        quick = _median(lambda way=way: way(card))  # type: ignore[misc]
        print(f"  {name:<34}{1e3 * whole:8.1f} ms{1e3 * two:8.1f} ms{1e3 * quick:8.1f} ms")


def _median(work: Callable[[], object], runs: int = RUNS) -> float:
    work()
    took = []
    for _ in range(runs):
        start = time.perf_counter()
        work()
        took.append(time.perf_counter() - start)
    return float(np.median(took))


def _steps(frames: Frames, rig: Calibration, grid: Grid) -> None:
    """The way of `scan_frames` step by step, the card at rest after each, beside the CPU's."""
    from numba import cuda

    fine, raw = locate(frames), triangulate(locate(frames), rig)
    beside = {
        DECODE: lambda: decode(frames),
        PLACE: lambda: locate(frames),
        POINTS: lambda: triangulate(fine, rig),
        MIXED: lambda: reject_mixed(raw),
        CELLS: lambda: to_scan(raw, rig, grid, frames.time),
    }
    on_cpu = {name: 1e3 * _median(work) for name, work in beside.items()}
    on_cpu[PLACE] -= on_cpu[DECODE]
    took: dict[str, list[float]] = {}

    def step(name: str, work: Callable[[], Result]) -> Result:
        start = time.perf_counter()
        done = work()
        cuda.synchronize()
        took.setdefault(name, []).append(1e3 * (time.perf_counter() - start))
        return done

    for _ in range(RUNS + 1):
        _one_scan(frames, rig, grid, step)
    held = step("(page-locked memory, once)", lambda: cuda.pinned_array(frames.stack.shape, frames.stack.dtype))
    held[:] = frames.stack
    for _ in range(RUNS):
        step("(frames, if they were in page-locked memory)", lambda: cuda.to_device(held))
    print(f"  {'step by step, median':<48}{'GPU':>11}{'CPU':>11}")
    for name, times in took.items():
        cpu = f"{on_cpu[name]:8.1f} ms" if name in on_cpu else ""
        print(f"    {name:<46}{np.median(times[1:] or times):8.2f} ms{cpu}")


def _one_scan(frames: Frames, rig: Calibration, grid: Grid, step: Callable[[str, Callable[[], Any]], Any]) -> None:
    from pipelines.reconstruction.cuda import filled, gray, laid, place, points, ways
    from pipelines.reconstruction.cuda.card import up, up_quickly

    step("(frames to the card from ordinary memory)", lambda: up(frames.stack))
    stack = step("frames to the card", lambda: up_quickly(frames.stack))
    light = step("light and noise (on the CPU)", lambda: read_light(frames, RUNS_OF_LIGHT))
    steps = step(DECODE, lambda: gray.decode_gray(frames, stack, light.noise))
    placed = step(PLACE, lambda: place.place(frames, steps, light))
    planes = step(POINTS, lambda: points.triangulate(placed, points.sight_of(placed, rig)))

    def clean() -> None:
        points.add_doubt(planes[3], doubt_mm(rig), 1.0)
        points.drop_mixed(planes)

    step(MIXED, clean)
    some = step("width of stripes (on the CPU)", lambda: ways._stripe_samples(placed.column, placed.row))
    texture = step("texture to the card", lambda: up(ways._texture(frames)))
    on_grid = step("clean up, lay on the grid", lambda: laid.lay(planes, rig, grid, background=False))
    usual = _usual(rig, grid)
    shared = sharing(stripe_px(some), some, shared_mm2(placed.shared, rig), rig, usual)
    given = on_grid, texture, placed.level, grid, usual, shared
    out = step(CELLS, lambda: filled.fill_cells(*given))
    step("height map back", lambda: [each.copy_to_host() for each in out])


if __name__ == "__main__":
    main()
