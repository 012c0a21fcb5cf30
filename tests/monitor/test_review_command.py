"""``microrelief review`` and ``microrelief report`` as people call them."""

from __future__ import annotations

import json
import socket
import sys
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from dashboards import behind_proxy, read_tracks
from monitor.cli import main
from pipelines import Grid, Scan, Tick, parse_instant
from storage import create_store, open_store
from tests.dashboards.drying import DryingStore, drying_store
from tests.dashboards.filled_store import fill_store


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return fill_store(drying_store(5, 40), tmp_path_factory.mktemp("campaign") / "plot.icechunk")


@pytest.fixture(scope="module")
def empty_store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    full = drying_store(1, 20)
    return fill_store(DryingStore(full.about), tmp_path_factory.mktemp("campaign") / "empty.icechunk")


@dataclass
class Ended:
    """How a call of the command line ended."""

    returncode: int
    stdout: str
    stderr: str


Run = Callable[..., Ended]


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    """Call the command line in an empty folder and without a screen."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)

    def call(*arguments: str | Path) -> Ended:
        monkeypatch.setattr(sys, "argv", ["microrelief", *map(str, arguments)])
        with pytest.raises(SystemExit) as left:
            main()
        shown = capsys.readouterr()
        assert isinstance(left.value.code, int)
        return Ended(left.value.code, shown.out, shown.err)

    return call


def one_line(ended: Ended) -> str:
    """The only line of stderr."""
    (line,) = ended.stderr.strip().splitlines()
    return line


def test_review_is_saved_and_says_how_to_open_it(store: Path, run: Run, tmp_path: Path) -> None:
    ended = run("review", store, "--save", "my review.rrd")
    assert ended.returncode == 0, ended.stderr
    assert (tmp_path / "my review.rrd").stat().st_size > 10_000
    assert "5 scans" in ended.stdout
    assert "rerun 'my review.rrd'\n" in ended.stdout
    assert "recording scans: 5 of 5" in ended.stderr


def test_review_without_a_screen_says_what_to_do(store: Path, run: Run) -> None:
    if sys.platform in ("darwin", "win32"):
        pytest.skip("these systems always have a screen")
    ended = run("review", store)
    assert ended.returncode == 1
    assert one_line(ended).startswith("microrelief: no screen here")
    assert "--web" in one_line(ended)
    assert "--save" in one_line(ended)


@pytest.mark.parametrize("command", [("review", "--save", "r.rrd"), ("report", "--out", "out")])
def test_a_path_that_is_no_store_is_said_in_one_line(command: tuple[str, ...], run: Run, tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    for path in ("nowhere", "folder"):
        ended = run(command[0], path, *command[1:])
        assert ended.returncode == 1
        assert path in one_line(ended)


def test_an_empty_store_cannot_be_reviewed(empty_store: Path, run: Run) -> None:
    ended = run("review", empty_store, "--save", "r.rrd")
    assert ended.returncode == 1
    assert "holds no scan yet" in one_line(ended)


def test_a_review_that_cannot_be_written_is_said_in_one_line(store: Path, run: Run, tmp_path: Path) -> None:
    (tmp_path / "taken.rrd").mkdir()
    (tmp_path / "file").write_text("")
    for place, why in (("taken.rrd", "is a folder"), ("file/r.rrd", "there is no folder file")):
        ended = run("review", store, "--save", place)
        assert ended.returncode == 2
        assert why in one_line(ended)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--follow", "--save", "r.rrd"), "--follow and --save exclude each other"),
        (("--scans", "a:b", "--save", "r.rrd"), "--scans a:b: give two numbers"),
        (("--scans", "7:9", "--save", "r.rrd"), "has no scans 7 to 9"),
        (("--origin", "https://a.org", "--save", "r.rrd"), "--origin is for --web"),
        (("--web", "--follow", "--origin", "https://a.org"), "--origin is for --web, without --follow"),
        (("--web", "--origin", "https://a.org/review"), "give an address without a path"),
        (("--web", "--data-origin", "https://a.org/"), "--data-origin needs --origin"),
    ],
)
def test_options_that_make_no_sense_are_refused(options: tuple[str, ...], says: str, store: Path, run: Run) -> None:
    ended = run("review", store, *options)
    assert ended.returncode == 2
    assert says in one_line(ended)


def test_the_link_behind_a_proxy_names_its_addresses_in_the_place_of_ours() -> None:
    here = "http://127.0.0.1:9090/?url=rerun%2Bhttp%3A%2F%2F127.0.0.1%3A9091%2Fdataset%2Fd1%3Fsegment_id%3Dp&theme=dark"
    there = "https://a.org/?url=rerun%2Bhttps%3A%2F%2Fdata.a.org%2Fdataset%2Fd1%3Fsegment_id%3Dp&theme=dark"
    assert behind_proxy(here, "https://a.org", "https://data.a.org") == there


def test_web_and_save_exclude_each_other(store: Path, run: Run) -> None:
    ended = run("review", store, "--web", "--save", "r.rrd")
    assert ended.returncode == 2
    assert "choose one" in one_line(ended)


@pytest.mark.parametrize("port", ["0", "65535", "99999"])
def test_a_port_that_does_not_exist_is_refused(port: str, store: Path, run: Run) -> None:
    ended = run("review", store, "--web", "--port", port)
    assert ended.returncode == 2
    assert "does not exist" in one_line(ended)


def test_a_busy_port_is_said_in_one_line(store: Path, run: Run) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        ended = run("review", store, "--web", "--port", str(port))
    assert ended.returncode == 1
    assert f"port {port} cannot be used" in one_line(ended)
    assert "--port" in one_line(ended)


def logged(file: Path, path: str) -> list[str]:
    """What a recording says at one path, in words."""
    from rerun.chunk import RrdReader

    said: list[str] = []
    for chunk in RrdReader(file).store().stream():
        if str(chunk.entity_path) == path:
            columns = chunk.to_record_batch().to_pydict()
            said += [str(value) for name, values in columns.items() if name.startswith("T") for value in values]
    return said


def test_a_remark_is_shown_by_review_and_report(run: Run, tmp_path: Path) -> None:
    store = fill_store(drying_store(3, 20), tmp_path / "plot.icechunk")
    about = ("--scan", "1", "--region=-2,-2,2,2", "--by", "Ann")
    ended = run("annotate", store, "watered,\n 200 ml", *about)
    assert ended.returncode == 0, ended.stderr
    told = "watered, 200 ml (Ann, scan 1, region (-2, -2), (2, -2), (2, 2), (-2, 2) mm)"
    assert ended.stdout == f"kept, 2026-05-04T12:00:00Z: {told}\n"
    assert run("annotate", store, "rain", "--time", "2026-05-04T14:00", "--by", "Bo").returncode == 0
    with closing(open_store(store, write=True)):  # while somebody writes it, it waits, and is shown all the same
        ended = run("annotate", store, "newest", "--by", "Cy")
        assert "takes it into the store with its next visit" in ended.stdout
        run("report", store, "--out", "out")
        run("review", store, "--save", "r.rrd")
    page = (tmp_path / "out/report.html").read_text()
    lines = "\n".join(logged(tmp_path / "r.rrd", "/log"))
    for words in (told, "rain (Bo)", "newest (Cy, scan 2)"):
        assert words in page
        assert words in lines
    assert "2026-05-04 14:00  annotation: rain" in lines


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ((" ",), "TEXT is empty"),
        (("rain", "--scan", "0", "--time", "2026-05-04"), "--scan and --time exclude each other"),
        (("rain", "--scan", "9"), "--scan 9: there is no such scan"),
        (("rain", "--time", "noon"), "--time noon: "),
        (("rain", "--time", "2126-05-04"), "is still to come"),
        (("rain", "--region", "9,9,10,10"), "the region holds no cell"),
    ],
)
def test_a_remark_about_nothing_is_refused(words: tuple[str, ...], says: str, store: Path, run: Run) -> None:
    ended = run("annotate", store, *words)
    assert ended.returncode == 2
    assert says in one_line(ended)


def test_paths_of_what_moves_are_shown_up_to_each_scan(store: Path, run: Run, tmp_path: Path) -> None:
    times = ("2026-05-04T06:00:00Z", "2026-05-04T12:00:00Z", "2026-05-05T00:00:00Z")
    rows = [f"{time},{name},{0.5 * n},{name},0.1" for n, time in enumerate(times) for name in (1, 2)]
    (tmp_path / "paths.csv").write_text("\n".join(["time,identity,x [mm],y [mm],z [mm]", *rows]))
    ended = run("review", store, "--save", "r.rrd", "--paths", "paths.csv", "--preset", "video")
    assert ended.returncode == 0, ended.stderr
    from rerun.chunk import RrdReader

    trails: dict[int, list[int]] = {}
    for chunk in RrdReader(tmp_path / "r.rrd").store().stream():
        if str(chunk.entity_path) == "/maps/paths/trails":
            columns = chunk.to_record_batch().to_pydict()
            strips = columns["LineStrips2D:strips"]
            trails |= {n: [len(each) for each in some] for n, some in zip(columns["scan"], strips, strict=True)}
    assert trails == {0: [1, 1], 1: [2, 2], 2: [3, 3], 3: [], 4: []}

    for text, why in (("a,b\n1,2\n", "no table of paths"), (rows[0], "no table of paths")):
        (tmp_path / "other.csv").write_text(text)
        assert why in one_line(run("review", store, "--save", "r.rrd", "--paths", "other.csv"))
    assert "No such file" in one_line(run("review", store, "--save", "r.rrd", "--paths", "gone.csv"))
    (tmp_path / "late.csv").write_text("time,identity,x,y,z\n2027-01-01T00:00:00Z,1,0,0,0\n")
    assert "is of another store" in one_line(run("review", store, "--save", "r.rrd", "--paths", "late.csv"))


def test_paths_find_their_scans_to_the_nanosecond_of_a_real_clock(tmp_path: Path) -> None:
    at, grid = parse_instant("2026-05-04T06:00:00.445425163Z"), Grid(4, 5, 0.1)
    flat, none = np.zeros(grid.shape, np.float32), np.zeros(grid.shape, np.uint8)
    store = create_store(tmp_path / "video.icechunk", site="plate", grid=grid)
    for seconds in range(2):
        time = at + np.timedelta64(seconds, "s")
        store.append(Tick(time, Scan(grid, time, flat, flat, none, none)))
    (tmp_path / "paths.csv").write_text("time,identity,x,y,z\n2026-05-04T06:00:01.445425163Z,1,0,0,0\n")
    assert read_tracks(tmp_path / "paths.csv", store)["scan"].tolist() == [1]
    store.close()


def test_report_of_a_site_in_alarm_exits_3(store: Path, run: Run, tmp_path: Path) -> None:
    ended = run("report", store, "--out", "out")
    assert ended.returncode == 3, ended.stderr
    assert ended.stdout.startswith("In alarm: Crack opening is ")
    assert {file.name for file in (tmp_path / "out").iterdir()} == {"report.html", "series.csv", "series.parquet"}


def test_report_as_json(store: Path, empty_store: Path, run: Run) -> None:
    ended = run("report", store, "--out", "out", "--json")
    summary = json.loads(ended.stdout)
    assert ended.returncode == 3
    assert (summary["verdict"], summary["scans"], summary["alarms"]) == ("red", 5, {"crack opening": "alarm"})
    assert summary["last"] == "2026-05-05T12:00:00Z"

    ended = run("report", empty_store, "--out", "out", "--json")
    summary = json.loads(ended.stdout)
    assert ended.returncode == 0, ended.stderr
    assert (summary["verdict"], summary["scans"], summary["last"]) == ("no data", 0, None)


@pytest.mark.parametrize("command", ["review", "report"])
def test_help_shows_an_example(command: str, run: Run) -> None:
    ended = run(command, "--help")
    assert ended.returncode == 0
    assert f"microrelief {command} demo/demo.icechunk" in " ".join(ended.stdout.split())
