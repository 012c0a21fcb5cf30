"""What a calibration cannot know: heights beyond a small board, copies of one pose, boards that are all parallel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from pipelines import Grid, PointMap, parse_instant
from pipelines.reconstruction import Board, Calibration, Lens, calibration_verdict, to_scan, triangulate
from pipelines.reconstruction.board_check import corner_points
from pipelines.reconstruction.bundle import Solution, adjust
from pipelines.reconstruction.calibration_sigma import parameter_sigma
from pipelines.reconstruction.corner_evidence import Fit
from pipelines.reconstruction.height_doubt import add_rows, doubt_mm, doubt_of_cells, with_doubt
from pipelines.reconstruction.pinhole import Floats, project, rotation, rotation_vector
from pipelines.reconstruction.pose_spread import copies, covered_share
from pipelines.reconstruction.sight import on_plane
from pipelines.reconstruction.solve import _rig, solve
from pipelines.reconstruction.stereo_start import PoseCorners, flat

from . import telecentric_rig as telecentric
from .exact_rig import BOARD, TILTS, flat_site, make_rig, see

PAPER = Board.of_squares((6, 7), 0.7)
"""The paper's board: 6x7 squares of 0.7 mm, here in a field of about 10 mm."""
SIZES = ((640, 400), (608, 684))
NOISE_PX = 0.05
STACK = ((0, 0, 0), (0.5, 0.2, 0.3), (-0.6, 0.1, -0.4), (0.2, -0.5, 0.6))


def shown(
    rig: Calibration, board: Board, tilts: Sequence[tuple[float, float]], places: Sequence[Sequence[float]], seed: int
) -> list[PoseCorners]:
    """Corners of a board at these tilts and places (mm from the middle of the field)."""
    random = np.random.default_rng(seed)
    middle = board.points_mm - board.points_mm.mean(axis=0)
    poses = []
    for n, ((a, b), place) in enumerate(zip(tilts, places, strict=True)):
        points = np.c_[middle, np.zeros(len(middle))] @ rotation(np.array([a, b, 0.0])).T + np.array(place)
        points[:, 2] += rig.reference[2, 3]
        seen, lit = project(rig.camera, points), project(rig.projector, points @ rig.R.T + rig.t_mm)
        seen, lit = (px + random.normal(0, NOISE_PX, px.shape) for px in (seen, lit))
        poses.append(PoseCorners(f"pose {n}", board.points_mm, seen, lit))
    return poses


def bent(rig: Calibration, seed: int) -> Calibration:
    """The rig with lenses that are distorted as lenses are: a per cent or two at the image's corner."""
    random = np.random.default_rng(seed)

    def lens(one: Lens) -> Lens:
        r = float(np.hypot(one.size[0] / 2 / one.K[0, 0], one.size[1] / 2 / one.K[1, 1]))
        k1, k2 = random.normal(0, 0.015) / r**2, random.normal(0, 0.005) / r**4
        p1, p2 = random.normal(0, 0.0015, 2) / r
        return replace(one, dist=np.array([k1, k2, p1, p2, 0.0]))

    return replace(rig, camera=lens(rig.camera), projector=lens(rig.projector))


@cache
def small_board(seed: int, spread_mm: float) -> tuple[Calibration, Calibration]:
    """A true rig, and what the paper's board in 5 poses makes of it."""
    rig = bent(make_rig(), 50 + seed)
    places = [(x * spread_mm, y * spread_mm, 0.3 * (n - 2)) for n, (x, y) in enumerate(AROUND)]
    return rig, refitted(rig, PAPER, TILTS, places, seed)


def refitted(
    rig: Calibration, board: Board, tilts: Sequence[tuple[float, float]], places: Sequence[Sequence[float]], seed: int
) -> Calibration:
    """What `solve` finds, on a short way: from the true rig on."""
    poses = shown(rig, board, tilts, places, seed)
    lenses = [
        np.array([one.K[0, 0], one.K[1, 1], one.K[0, 2], one.K[1, 2], *one.dist[:4]])
        for one in (rig.camera, rig.projector)
    ]
    turns = np.array([rotation_vector(rotation(np.array([a, b, 0.0]))) for a, b in tilts])
    shifts = np.array(places, dtype=np.float64) + np.array([0, 0, rig.reference[2, 3]])
    begin = Solution(lenses[0], lenses[1], rotation_vector(rig.R), rig.t_mm, turns, shifts)
    corners, noise = flat(poses), (NOISE_PX, NOISE_PX)
    here = Fit(tuple(range(len(poses))), corners, adjust(corners, begin, SIZES, noise), noise, {})
    sigma = parameter_sigma(here, 0, SIZES, [pose.name for pose in poses])
    return replace(_rig(here, here.solution, 0, SIZES), sigma=sigma)


def test_the_short_way_finds_what_solve_finds() -> None:
    short, whole = small_board(0, 0.3)[1], small_board_solved()
    assert short.sigma is not None
    assert (
        abs(whole.camera.K - short.camera.K).max() < short.sigma["camera"]["fx"]
    )  # the noise's weights differ a little
    assert np.median(doubt_mm(whole) / doubt_mm(short)) == pytest.approx(1, abs=0.2)


@cache
def small_board_solved() -> Calibration:
    places = [(0.3 * x, 0.3 * y, 0.3 * (n - 2)) for n, (x, y) in enumerate(AROUND)]
    return solve(shown(bent(make_rig(), 50), PAPER, TILTS, places, 0), *SIZES, PAPER, 0, "")


AROUND = ((0, 0), (-1, -0.6), (1, 0.6), (-1, 0.6), (1, -0.6))


def field_errors(true: Calibration, found: Calibration) -> tuple[Floats, Floats, Floats]:
    """Depth errors over the whole field, laid rigidly onto the truth; their sigma; the true points."""
    pixels = np.stack(np.meshgrid(np.linspace(0, 639, 25), np.linspace(0, 399, 17)), axis=-1).reshape(-1, 2)
    points = on_plane(true.camera, true.reference, pixels)
    lit = project(true.projector, points @ true.R.T + true.t_mm)
    both = ((lit >= 0) & (lit <= np.array(SIZES[1]) - 1)).all(axis=1)
    pixels, points, lit = pixels[both], points[both], lit[both]
    got = corner_points(found, pixels, lit)
    a, b = got - got.mean(axis=0), points - points.mean(axis=0)
    U, _, V = np.linalg.svd(a.T @ b)
    sigma = np.zeros((400, 640), np.float32)
    x, y = pixels[:, 0].round().astype(int), pixels[:, 1].round().astype(int)
    blank, grey = np.zeros((400, 640, 3), np.float32), np.zeros((400, 640), np.uint8)
    with_doubt(PointMap(blank, sigma, blank, grey, grey), found)
    return (a @ (U @ V) - b)[:, 2], sigma[y, x].astype(np.float64), points


@pytest.mark.parametrize("spread_mm", [0.3, 2.5])
def test_sigma_knows_what_a_small_board_leaves_open_over_the_whole_field(spread_mm: float) -> None:
    """The error is one smooth bow per calibration: many of them tell its size."""
    inside, outside = [], []
    for seed in range(16):
        error, sigma, points = field_errors(*small_board(seed, spread_mm))
        near = (np.abs(points[:, 0]) < 1.4 + spread_mm) & (np.abs(points[:, 1]) < 1.75 + 0.6 * spread_mm)
        inside.append(np.mean((error / sigma)[near] ** 2))
        outside.append(np.mean((error / sigma)[~near] ** 2))
    here, beyond = float(np.sqrt(np.mean(inside))), float(np.sqrt(np.mean(outside)))
    print(f"board spread over {spread_mm} mm: error over sigma {here:.2f} where boards were, {beyond:.2f} beyond")
    assert here == pytest.approx(1, abs=0.3)
    assert beyond == pytest.approx(1, abs=0.3)


def test_the_map_is_large_where_no_board_was_and_small_where_boards_were() -> None:
    rig = small_board(0, 0.3)[1]
    coarse = 1000 * doubt_mm(rig)
    assert coarse.shape == (9, 12)
    assert coarse[0, 0] > 2 * coarse[4, 5]  # a plane over the whole field is taken out, so some is left in the middle
    assert rig.sigma is not None
    assert np.sqrt((coarse**2).mean()) == pytest.approx(rig.sigma["field"]["bow_image_um"], rel=0.3)
    again = Calibration.from_json(rig.to_json())
    assert (doubt_mm(again) == doubt_mm(rig)).all()
    # A file from before there were maps tells one value, and one without sigma nothing.
    field = {key: value for key, value in rig.sigma["field"].items() if key != "map_um"}
    old = replace(rig, sigma={**rig.sigma, "field": field})
    assert doubt_mm(old) == pytest.approx(np.float32(field["bow_image_um"] / 1000))
    assert (doubt_mm(replace(rig, sigma=None)) == 0).all()


def test_sigma_of_points_and_cells_holds_the_map_which_no_mean_makes_less() -> None:
    rig = small_board(0, 0.3)[1]
    decoded, _ = see(rig, flat_site)
    points = triangulate(decoded, rig)
    bare = triangulate(decoded, replace(rig, sigma=None))
    without = np.empty_like(points.sigma_z)
    add_rows(points.sigma_z, doubt_mm(rig), -1.0, without, 0, len(without))
    assert without[bare.valid] == pytest.approx(bare.sigma_z[bare.valid], rel=2e-3)
    coarse = doubt_mm(rig)
    assert points.sigma_z[0, 0] == pytest.approx(np.hypot(bare.sigma_z[0, 0], coarse[0, 0]), rel=1e-4)
    grid = Grid(20, 30, 0.4, -5.8, -3.8)
    scan = to_scan(points, rig, grid, parse_instant("2026-11-22T12:00:00Z"))
    alone = np.zeros(grid.shape, np.float32)
    doubt_of_cells(alone, grid, rig)
    seen = np.isfinite(scan.sigma)
    assert (scan.sigma[seen] >= alone[seen]).all()
    assert np.median(scan.sigma[seen] / alone[seen]) < 1.1  # hundreds of points a cell: the map is what is left


def test_the_verdict_says_how_little_of_the_field_the_board_covered() -> None:
    rig = small_board_solved()
    covered = covered_share(rig)
    assert covered == pytest.approx(2.8 * 3.5 / (15.6 * 9.8), rel=0.6)
    said = [line for line in calibration_verdict(rig) if "of the field" in line]
    assert len(said) == 1
    assert said[0].startswith(
        f"the boards cover only {covered:.0%} of the field: heights beyond them are extrapolated, ±"
    )
    assert "take poses with the board in every corner of the field, or a larger board" in said[0]
    wide = Board((13, 9), 1.0)  # nearly fills it
    places = [(0.4 * x, 0.4 * y, 0.1 * n) for n, (x, y) in enumerate(AROUND)]
    full = solve(shown(make_rig(), wide, TILTS, places, 0), *SIZES, wide, 0, "")
    assert not any("of the field" in line for line in calibration_verdict(full))


def test_copies_of_one_pose_are_refused_and_a_single_copy_is_left_out() -> None:
    same = shown(make_rig(), BOARD, [(0.0, 0.0)] * 3, [STACK[0]] * 3, 1)
    with pytest.raises(
        ValueError, match="1 of 3 poses differ, at least 3 must: the board stands in pose 1 as in pose 0"
    ):
        solve(same, *SIZES, BOARD, 0, "")
    exact = [replace(same[0], name=name) for name in "abc"]
    with pytest.raises(ValueError, match="b as in a, c as in a: capture it at other tilts"):
        solve(exact, *SIZES, BOARD, 0, "")
    tilts = [TILTS[0], TILTS[1], TILTS[2], TILTS[1]]
    four = shown(make_rig(), BOARD, tilts, [STACK[0]] * 4, 1)
    assert copies(four, 0) == {3: 1}
    assert copies(four, 3) == {1: 3}  # heights count from the copy: then the other one is left out
    rig = solve(four, *SIZES, BOARD, 3, "")
    assert ["so it tells nothing new" in pose.advice for pose in rig.poses] == [False, True, False, False]


PARALLEL = [
    ("pinholes, tilted", make_rig, SIZES, BOARD, (0.3, 0.2)),
    ("telecentric, flat", telecentric.make_rig, telecentric.SIZES, telecentric.BOARD, (0.0, 0.0)),
]


@pytest.mark.parametrize(("what", "make", "sizes", "board", "tilt"), PARALLEL, ids=[row[0] for row in PARALLEL])
def test_boards_that_are_all_parallel_determine_nothing(what, make, sizes, board, tilt) -> None:  # type: ignore[no-untyped-def]  # a table's row
    poses = shown(make(), board, [tilt] * 4, STACK, 2)
    with pytest.raises(
        ValueError, match=r"these poses do not determine the rig: the scale of heights is known to .* only"
    ):
        solve(poses, sizes[0], sizes[1], board, 0, "", side="right")


def test_small_tilts_are_told_by_how_sure_they_leave_heights() -> None:
    """No angle is forbidden: what counts is what the corners know, and errors are of the size that is told."""
    tilts, ratios = [(0.0, 0.0), (0.07, 0.0), (0.0, 0.07), (-0.07, 0.01)], []
    for seed in range(12):
        true = make_rig()
        rig = refitted(true, BOARD, tilts, STACK, seed)
        low, high = (telecentric.seen_by(true, rig, np.array([[0.0, 0, z], [2, 1, z]])) for z in (-0.5, 0.5))
        assert rig.sigma is not None
        ratios.append(((high - low)[:, 2].mean() - 1) * 100 / rig.sigma["field"]["height_scale_percent"])
    assert 0.4 < np.sqrt(np.mean(np.square(ratios))) < 1.8
    told = calibration_verdict(solve(shown(make_rig(), BOARD, tilts, STACK, 0), *SIZES, BOARD, 0, ""))
    assert any(line.startswith("the scale of heights is known to ±0.") and "tilt" in line for line in told)
