"""``microrelief compare``: what it writes and prints, on surfaces in closed form."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from monitor.cli import run_tokens
from pipelines import Tick, parse_instant
from pipelines.change import m3c2
from storage import create_store, read_height_map, write_height_map
from tests.pipelines.change.scans import bumps, sampled, scan_of

SURFACE = bumps(seed=2)
PITCH = 0.02


def heap(x: npt.NDArray[np.float64], y: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """A heap of 0.1 mm with a spread of 0.25 mm: 2 pi 0.25^2 0.1 mm3."""
    return 0.1 * np.exp(-((x - 2) ** 2 + (y - 1.6) ** 2) / (2 * 0.25**2))


VOLUME = 2 * np.pi * 0.25**2 * 0.1


@pytest.fixture
def maps(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    random = np.random.default_rng(0)
    before = sampled(SURFACE) + random.normal(0, 0.002, (160, 200))
    after = sampled(lambda x, y: SURFACE(x, y) + heap(x, y)) + random.normal(0, 0.002, (160, 200))
    after[:20, :30] = np.nan
    write_height_map(scan_of(before), tmp_path / "before.npz")
    write_height_map(scan_of(after), tmp_path / "after.npz")
    write_height_map(scan_of(after), tmp_path / "after.tif")
    moved = sampled(lambda x, y: SURFACE(x - 0.047, y + 0.033) + heap(x - 0.047, y + 0.033)) + 0.03
    write_height_map(scan_of(moved + random.normal(0, 0.002, moved.shape)), tmp_path / "moved.npz")
    np.savez(tmp_path / "plain.npz", height=after, pitch_mm=PITCH)
    return tmp_path


def measured(said: str, name: str) -> tuple[float, float]:
    found = re.search(rf"volume {name} +(\S+) ± (\S+)", said)
    assert found is not None, said
    return float(found[1].replace("\N{MINUS SIGN}", "-")), float(found[2])


@pytest.mark.parametrize("after", ["after.npz", "after.tif", "plain.npz"])
def test_distances_are_those_of_m3c2_and_volumes_are_printed(
    maps: Path, capsys: pytest.CaptureFixture[str], after: str
) -> None:
    options = ["--normal-radius", "0.11", "--radius", "0.07", "--max-distance", "0.3", "--registration-error", "0.001"]
    assert run_tokens(["compare", "before.npz", after, *options, "--out", "c.npz"]) == 0
    said = capsys.readouterr().out
    with np.load("before.npz") as one, np.load("plain.npz") as two, np.load("c.npz") as found:
        expected = m3c2(
            one["height"],
            two["height"].astype(np.float32),
            PITCH,
            normal_radii_mm=(0.11,),
            radius_mm=0.07,
            max_distance_mm=0.3,
            registration_error_mm=0.001,
        )
        for name in ("distance", "lod", "spread1", "spread2"):
            assert found[name].shape == (160, 200)
            np.testing.assert_allclose(found[name], getattr(expected, name), atol=2e-6)
        for name in ("n1", "n2"):
            assert (found[name] == getattr(expected, name)).mean() > 0.999
        assert found["distance"][80, 100] > 0.05  # the heap lies above: positive
        assert found["distance"][80, 100] > found["lod"][80, 100]
    net, sigma = measured(said, "net")
    assert abs(net - VOLUME) < 3 * sigma
    assert sigma == pytest.approx(0.001 * 0.981 * 160 * 200 * PITCH**2, rel=0.1)  # the registration's error, everywhere
    gained, lost = measured(said, "gained"), measured(said, "lost")
    assert gained[0] - lost[0] == pytest.approx(net, abs=sigma)
    assert "98.1 % of BEFORE's cells" in said


def test_differences_of_heights_cell_by_cell(maps: Path) -> None:
    assert run_tokens(["compare", "before.npz", "after.npz", "--method", "dod", "--out", "c.npz"]) == 0
    with np.load("before.npz") as one, np.load("after.npz") as two, np.load("c.npz") as found:
        np.testing.assert_allclose(found["distance"], two["height"] - one["height"], atol=1e-6)
        both = np.isfinite(two["height"])
        np.testing.assert_array_equal(found["n2"], both)
        np.testing.assert_allclose(found["lod"][both], 1.96 * 0.002 * np.sqrt(2), rtol=1e-3)


def test_it_registers_only_when_asked(maps: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["compare", "before.npz", "moved.npz", "--out", "c.npz"]
    assert run_tokens(words) == 0
    with np.load("c.npz") as found:
        assert np.nanmedian(found["distance"]) == pytest.approx(0.03, abs=0.003)
    assert "registered" not in capsys.readouterr().out
    assert run_tokens([*words, "--register"]) == 0
    said = capsys.readouterr().out
    x, y, z = (float(each) for each in re.findall(r"[-+]\d\.?\d*(?:e-?\d+)?", said.split("moved by")[1])[:3])
    assert [x, y] == pytest.approx([-0.047, 0.033], abs=0.001)
    assert z == pytest.approx(-0.03, abs=0.002)
    with np.load("c.npz") as found:
        assert np.nanmedian(np.abs(found["distance"])) < 0.003
        assert found["distance"][80, 100] > 0.05
    net, sigma = measured(said, "net")
    assert abs(net - VOLUME) < 3 * sigma


def test_cells_of_another_size_are_interpolated_and_it_says_so(maps: Path, capsys: pytest.CaptureFixture[str]) -> None:
    y, x = np.mgrid[:128, :160] * 0.025
    write_height_map(scan_of(SURFACE(x, y) + heap(x, y), 0.025), maps / "coarse.npz")
    assert run_tokens(["compare", "before.npz", "coarse.npz", "--out", "c.npz"]) == 0
    said = capsys.readouterr().out
    assert "cells of 0.025 mm are interpolated to BEFORE's of 0.02 mm" in said
    assert measured(said, "net")[0] == pytest.approx(VOLUME, rel=0.05)


def test_a_map_against_itself_has_not_changed(maps: Path) -> None:
    assert run_tokens(["compare", "before.npz", "before.npz", "--statistic", "median", "--out", "c.npz"]) == 0
    with np.load("c.npz") as found:
        assert np.nanmax(np.abs(found["distance"])) == 0
        np.testing.assert_array_equal(found["n1"], found["n2"])


def test_help_shows_an_example(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_tokens(["compare", "--help"]) == 0
    shown = capsys.readouterr().out
    assert "Example" in shown
    assert "microrelief compare " in shown


@pytest.fixture
def site(maps: Path) -> Path:
    """The two maps as scans 0 and 1 of a store, and as 2 the moved one."""
    store = create_store(maps / "site.icechunk", site="site", grid=scan_of(sampled(SURFACE)).grid)
    for number, name in enumerate(("before", "after", "moved")):
        scan = read_height_map(maps / f"{name}.npz")
        time = parse_instant(f"2026-01-01T{number:02d}:00:00Z")
        store.append(Tick(time, replace(scan, time=time)))
    store.close()
    return maps


def test_scans_of_a_store(site: Path, capsys: pytest.CaptureFixture[str]) -> None:
    options = ["--method", "dod", "--out", "c.npz"]
    assert run_tokens(["compare", "site.icechunk@0", "site.icechunk@2026-01-01T01:10:00Z", *options]) == 0
    said = capsys.readouterr().out
    assert "scan 1 of 2026-01-01T01:00:00Z" in said
    net, sigma = measured(said, "net")
    assert abs(net - VOLUME) < 3 * sigma
    with np.load("c.npz") as found, np.load("before.npz") as one, np.load("after.npz") as two:
        np.testing.assert_allclose(found["distance"], two["height"] - one["height"], atol=6e-4)  # stored in 0.5 um
        np.testing.assert_array_equal(found["motion"], np.eye(4))
    # a file beside a scan of a store
    assert run_tokens(["compare", "before.npz", "site.icechunk@-1", *options]) == 0
    assert "scan 2 of" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["site.icechunk", "after.npz"], "is a store: say which scan, site.icechunk@12"),
        (["site.icechunk@7", "after.npz"], "site.icechunk@7: there is no such scan, the newest is 2"),
        (["before.npz", "nowhere.icechunk@1"], "nowhere.icechunk"),
        (["before.npz", "after.npz", "--stable", "plain.npz"], "list of polygons"),
        (["before.npz", "after.npz", "--stable", "none.json"], "No such file"),
    ],
)
def test_what_is_no_scan_or_area_is_said(
    site: Path, capsys: pytest.CaptureFixture[str], words: list[str], said: str
) -> None:
    assert run_tokens(["compare", *words, "--out", "c.npz"]) != 0
    assert said in capsys.readouterr().err


def test_stable_areas_show_what_settled(maps: Path, capsys: pytest.CaptureFixture[str]) -> None:
    frame = [[[-1, -1], [5, -1], [5, 0.6], [-1, 0.6]], [[-1, 2.6], [5, 2.6], [5, 5], [-1, 5]]]
    (maps / "frame.json").write_text(json.dumps(frame), encoding="utf-8")
    with np.load("before.npz") as kept:
        height = kept["height"].copy()
    settled = height + 0.05
    settled[31:130] -= 0.02
    write_height_map(scan_of(settled + np.random.default_rng(5).normal(0, 0.002, height.shape)), maps / "settled.npz")
    words = ["compare", "before.npz", "settled.npz", "--method", "dod", "--register", "--out", "c.npz"]
    assert run_tokens([*words, "--stable", "frame.json"]) == 0
    said = capsys.readouterr().out
    net, sigma = measured(said, "net")
    assert abs(net - -0.02 * 99 * 200 * PITCH**2) < 3 * sigma
    assert "one error for all cells" in said
    assert "outside of the stable areas" in said
    with np.load("c.npz") as found:
        assert np.nanmedian(found["distance"][40:120]) == pytest.approx(-0.02, abs=0.001)


def test_roughness_of_a_file_and_of_a_stored_scan(site: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_tokens(["roughness", "before.npz", "--s-filter", "0", "--form", "0", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["filters"] == {"s_mm": None, "l_mm": None, "form": 0}
    with np.load("before.npz") as kept:
        assert told["parameters"]["Sq"]["value"] == pytest.approx(kept["height"].std(), rel=1e-6)
    assert run_tokens(["roughness", "site.icechunk@0", "--l-filter", "0.8"]) == 0
    said = capsys.readouterr().out
    assert "S 0.06 mm, F plane, L 0.8 mm" in said
    assert re.search(r"Sq +\S+ ± \S+ mm", said)
    assert run_tokens(["roughness", "before.npz", "--l-filter", "0.01"]) != 0
    assert "finer than the L-filter" in capsys.readouterr().err
    assert run_tokens(["roughness", "--help"]) == 0
    assert "microrelief roughness " in capsys.readouterr().out
