"""What a report may be asked for: a period, a region, a comparison, templates of one's own, a PDF, a film."""

from __future__ import annotations

import base64
import io
import os
import subprocess
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pikepdf
import pytest
from PIL import Image

from configs import InputError
from dashboards import (
    Layout,
    Period,
    Region,
    fill_templates,
    gather,
    gather_comparison,
    gather_numbers,
    write_comparison,
    write_findings,
    write_movie,
)
from dashboards.findings import Findings
from dashboards.plain_words import in_plain_words
from dashboards.report import make_sections
from dashboards.sections import alarms, cracks, metrics, provenance, trends, weekly
from monitor.cli import run_tokens
from pipelines import Acknowledgement, AlarmChange, Comparison
from pipelines.change import measure

from .drying import SIX_HOURS, START, DryingStore, drying_store
from .filled_store import fill_store
from .test_report import Page

GOLDEN = Path(__file__).parent / "golden"


@pytest.fixture(scope="module")
def findings(drying: DryingStore) -> Findings:
    return gather(drying)


@pytest.fixture(scope="module")
def written(drying: DryingStore, findings: Findings, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("report")
    write_findings(findings, folder, Layout(pdf=True))
    return folder


def test_the_words_of_the_page_are_those_that_were_read_and_found_good(written: Path) -> None:
    """`MICRORELIEF_GOLDEN=write pytest -k words_of_the_page` writes the file anew; read what changed in it."""
    words = "\n".join(" ".join(word.split()) for word in Page((written / "report.html").read_text("utf-8")).words)
    words = "\n".join(line for line in words.splitlines() if line) + "\n"
    file = GOLDEN / "report.txt"
    if os.environ.get("MICRORELIEF_GOLDEN") == "write":
        file.write_text(words, encoding="utf-8")
    assert words == file.read_text(encoding="utf-8")


def test_every_link_of_the_page_leads_somewhere_and_no_place_has_two_of_a_name(written: Path) -> None:
    text = (written / "report.html").read_text("utf-8")
    page = Page(text)
    places = [part.partition('"')[0] for part in text.split(' id="')[1:]]
    assert len(places) == len(set(places))
    assert {link[1:] for link in page.links if link.startswith("#")} <= set(places)


def test_the_newest_number_leads_to_what_made_it(findings: Findings) -> None:
    made = metrics(findings)
    told = provenance(findings)
    assert made is not None
    row = made.tables[0].rows[0]
    anchors = {
        cell.anchor for table in told.tables for line in table.rows for cell in line if not isinstance(cell, str)
    }
    assert [cell.link for cell in row[1:3] if not isinstance(cell, str)] == ["made-in-epoch-0"] * 2
    assert "made-in-epoch-0" in anchors
    assert {"snapshot", "settings"} <= anchors


def test_exceedances_come_with_what_was_done_about_them(drying: DryingStore) -> None:
    at = [START + visit * SIX_HOURS for visit in range(10)]
    told = (
        AlarmChange(at[0], "crack opening", "ok", "warning", "0.26 mm").event,
        AlarmChange(at[1], "crack opening", "warning", "alarm", "0.4 mm").event,
        Acknowledgement(at[2], "crack opening", "Ann", "sealed").event,
        AlarmChange(at[3], "crack opening", "alarm", "ok", "0.2 mm").event,
        AlarmChange(at[5], "crack opening", "ok", "warning", "0.3 mm").event,
    )
    section = alarms(gather(replace(drying, events=told)))
    assert section is not None
    first, second = section.tables[1].rows
    said = "acknowledged by Ann: sealed, 2026-05-04 18:00 UTC"
    assert first == (
        "crack opening", "alarm", "2026-05-04 06:00 UTC", "2026-05-05 00:00 UTC", "0.4 mm", said
    )  # fmt: skip
    assert second[1:4] == ("warning", "2026-05-05 12:00 UTC", "still")
    assert second[5] == "none recorded"


def test_time_to_limit_is_that_of_a_straight_line() -> None:
    store = drying_store(9, 16)
    table = store.table.copy()
    days = np.array((table.index - table.index[0]).total_seconds()) / 86400
    table["edge_lift"], table["edge_lift_sigma"] = 1.0 + 2.0 * days, 1e-6
    section = trends(gather(replace(store, table=table)))
    assert section is not None
    ahead = next(table for table in section.tables if table.caption == "Time to limit")
    row = next(row for row in ahead.rows if str(row[0]) == "Edge lift")
    left = (9 - (1 + 2 * days[-1])) / 2  # the warning stands at 9 mm
    assert str(row[3]).startswith(f"in {int(left)} d {round(left % 1 * 24)} h (95")


def test_weeks_begin_on_monday_and_tell_what_each_added() -> None:
    store = drying_store(60, 10)
    section = weekly(gather(store))
    assert section is not None
    volume = section.tables[0]
    assert [str(row[0]) for row in volume.rows] == ["2026-05-04", "2026-05-11", "2026-05-18"]
    assert sum(int(str(row[1])) for row in volume.rows) == 60
    values = [float(str(row[2]).split(" ")[0].replace("−", "-")) for row in volume.rows]
    added = [float(str(row[3]).split(" ")[0].replace("−", "-")) for row in volume.rows[1:]]
    np.testing.assert_allclose(np.diff(values), added, atol=0.011)


def test_the_crack_of_the_crust_is_in_the_table_as_wide_as_it_was_drawn(findings: Findings) -> None:
    section = cracks(findings)
    assert section is not None
    longest = section.tables[0].rows[0]
    assert 8 < float(str(longest[1]).split(" ")[0]) < 14
    assert float(str(longest[2]).split(" ")[0]) == pytest.approx(0.12 + 0.45 * (1 - np.exp(-2.5)), abs=0.1)


def test_plain_words_say_only_what_is_sure(findings: Findings) -> None:
    told = in_plain_words(findings)
    assert told[0] == "Watched for 1 d 12 h, until 2026-05-05 18:00 UTC: 6 scans, one planned visit gave none."
    assert told[1].startswith("More material sank or went than rose since the first scan: 2.")
    assert any(line.startswith("The edges along the cracks have lifted by 0.17") for line in told)


def test_a_period_shows_its_own_scans_against_the_same_baseline(drying: DryingStore) -> None:
    found = gather(drying, period=Period(START + 3 * SIX_HOURS, START + 5 * SIX_HOURS))
    assert found.scans == 3
    assert found.series["scan"].tolist() == [2, 3, 4]
    assert found.first is not None
    assert found.last is not None
    assert (found.first.number, found.last.number) == (0, 4)
    assert all(START + 3 * SIX_HOURS <= visit.planned <= START + 5 * SIX_HOURS for visit in found.visits)
    assert make_sections(found)[0].name == "verdict"
    with pytest.raises(InputError, match="no scan lies in that period"):
        gather(drying, period=Period(START + 99 * SIX_HOURS))
    assert gather_numbers(drying, Period(), 3) == [0, 2, 5]


def test_metrics_inside_a_region_are_those_of_its_cells(drying: DryingStore) -> None:
    region = Region.parse("-4,-4,-2,4")
    found = gather(drying, region=region)
    newest, base = drying.scans[-1], drying.scans[0]
    assert newest.change is not None
    grid = newest.scan.grid
    mask = region.cells(grid)
    nothing = np.zeros(grid.shape, dtype=np.bool_)
    whole = Comparison(base.scan, newest.scan, newest.change, nothing, mask)
    expected = measure(whole, ["net_volume"])["net_volume"].value
    assert found.newest("net_volume").value == pytest.approx(expected, rel=1e-6)
    dz = newest.change.dz[mask]
    assert expected == pytest.approx(float(np.nansum(dz)) * grid.pitch_mm**2, rel=1e-3)
    assert abs(expected - drying.table["net_volume"].iloc[-1]) > 0.5, "it is another number than the store's"


def test_inside_a_region_every_scan_is_measured_where_that_is_affordable(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dashboards.findings._MOST_READ", 3)
    store, region = drying_store(6, 24), Region.parse("-4,-4,4,4")
    assert len(gather(store).quality) == 3
    assert len(gather(store, region=region).times) == 6
    monkeypatch.setattr("dashboards.findings._MEASURED_CELLS", 4 * 24 * 24)
    assert len(gather(store, region=region).times) == 4


@pytest.mark.parametrize("text", ["", "1,2,3", "1,2,3,4,5", "a,b,c,d", "nan,0,1,1"])
def test_a_region_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="--region"):
        Region.parse(text)


def test_a_comparison_measures_from_the_one_to_the_other(drying: DryingStore, tmp_path: Path) -> None:
    found = gather_comparison(drying, 5, 2)
    assert found.first is not None
    assert found.last is not None
    assert (found.first.number, found.last.number, found.last.baseline) == (2, 5, 2)
    assert found.last.change is not None
    truth = drying.scans[5].scan.height - drying.scans[2].scan.height
    known = np.isfinite(truth) & np.isfinite(found.last.change.dz)
    assert np.std((found.last.change.dz - truth)[known]) < 0.005, "but for settlement: no stable areas are named"
    page = Page(write_comparison(found, tmp_path).read_text(encoding="utf-8"))
    assert page.sections[:3] == ["between", "maps", "cracks"]
    assert "Scan 2 of 2026-05-04 18:00 UTC" not in page.text, "the third visit gave none"
    assert "Scan 2 of 2026-05-05 00:00 UTC against scan 5 of 2026-05-05 18:00 UTC, 18 h later." in page.text
    with pytest.raises(InputError, match="both are scan 2"):
        gather_comparison(drying, 2, 2)


def test_templates_of_ones_own_go_before_ours(findings: Findings, tmp_path: Path) -> None:
    own = tmp_path / "own"
    assert fill_templates(own)
    assert not fill_templates(own), "what is there is left alone"
    for file in own.iterdir():
        file.unlink()
    (own / "report.html").write_text(
        '{% extends "shipped/report.html" %}{% block footer %}<p>ACME geotechnics, order {{ site }}</p>{% endblock %}'
    )
    page = write_findings(findings, tmp_path / "out", Layout(templates=own)).read_text(encoding="utf-8")
    assert "<p>ACME geotechnics, order Plot 7, north bank</p>" in page
    assert 'id="verdict"' in page
    (own / "report.html").write_text("{% for section in %}")
    with pytest.raises(InputError, match=r"report\.html:1"):
        write_findings(findings, tmp_path / "out", Layout(templates=own))


def test_the_pdf_claims_both_standards_is_tagged_embeds_its_fonts_and_carries_the_series(written: Path) -> None:
    with pikepdf.open(written / "report.pdf") as pdf:
        assert 4 <= len(pdf.pages) <= 9, "a column that collapses makes many"
        meta = pdf.open_metadata()
        assert (meta["pdfaid:part"], meta["pdfaid:conformance"], meta["pdfuaid:part"]) == ("3", "B", "1")
        assert meta["dc:title"] == "Plot 7, north bank: Surface report"
        root = pdf.Root
        assert str(root.Lang) == "en"
        assert bool(root.MarkInfo.Marked)
        assert bool(root.ViewerPreferences.DisplayDocTitle)
        assert root.OutputIntents[0].S == pikepdf.Name.GTS_PDFA1
        assert bytes(pdf.attachments["series.csv"].get_file().read_bytes()) == (written / "series.csv").read_bytes()
        found = list(_elements(root.StructTreeRoot))
        kinds = {str(each.S) for each in found}
        assert {"/H1", "/Table", "/TH", "/TD", "/Figure", "/Caption", "/Link"} <= kinds
        assert all(len(str(each.Alt)) > 20 for each in found if pikepdf.Name.Figure == each.S)
        fonts = [font for page in pdf.pages for font in page.resources.get("/Font", {}).values()]
        assert fonts
        for font in fonts:
            inner = font.DescendantFonts[0] if "/DescendantFonts" in font else font
            assert {"/FontFile", "/FontFile2", "/FontFile3"} & set(inner.FontDescriptor.keys())
            assert "/ToUnicode" in font


def _elements(node: pikepdf.Object) -> Iterator[pikepdf.Object]:
    """Every element of a structure tree."""
    below = node.get("/K")
    for each in below if isinstance(below, pikepdf.Array) else [below]:
        if isinstance(each, pikepdf.Dictionary) and "/S" in each:
            yield each
            yield from _elements(each)


@pytest.mark.parametrize("suffix", [".mp4", ".gif"])
def test_a_film_has_a_frame_for_each_scan_on_one_scale(drying: DryingStore, suffix: str, tmp_path: Path) -> None:
    out = tmp_path / f"change{suffix}"
    write_movie(drying, range(6), out, title="Plot 7", fps=5, width=400)
    assert [file.name for file in tmp_path.iterdir()] == [out.name]
    frames = list(_frames(out))
    assert len(frames) == 6
    first, last = frames[0].astype(float), frames[-1].astype(float)
    down, across = first.shape[:2]
    assert abs(across - 400) <= 2
    panels = slice(int(0.2 * down), int(0.7 * down))
    share = {}
    for name, frame in (("first", first), ("last", last)):
        red, _, blue = np.moveaxis(frame[panels, across // 2 + 10 :], -1, 0)
        share[name] = float((red > 2 * blue + 20).mean())
    assert share["last"] > 0.02, "the crack is red"
    assert share["first"] == 0
    bars = slice(int(0.8 * down), int(0.9 * down))
    assert np.abs(first[bars] - last[bars]).mean() < 3, "the scales stay"


def _frames(film: Path) -> Iterator[np.ndarray]:
    if film.suffix == ".gif":
        with Image.open(film) as picture:
            for number in range(getattr(picture, "n_frames", 1)):
                picture.seek(number)
                yield np.array(picture.convert("RGB"))
        return
    import imageio_ffmpeg

    pictures = film.parent / "frames"
    pictures.mkdir()
    ffmpeg = imageio_ffmpeg.get_ffmpeg_exe()
    subprocess.run([ffmpeg, "-loglevel", "error", "-i", str(film), str(pictures / "%03d.png")], check=True)
    for file in sorted(pictures.iterdir()):
        yield np.array(Image.open(file).convert("RGB"))


def test_the_commands_take_periods_regions_comparisons_and_films(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    store = str(fill_store(drying_store(6, 24), tmp_path / "plot.icechunk"))

    def run(*words: str) -> tuple[int, str]:
        code = run_tokens(list(words))
        told = capsys.readouterr()
        return code, told.out + told.err

    out = str(tmp_path / "out")
    assert run("report", store, "--out", out, "--from", "2026-05-05", "--to", "4", "--region=-4,-4,4,4")[0] in (0, 3)
    assert run("report", store, "--out", out, "--compare", "1", "2026-05-05T18:00:00Z")[0] == 0
    assert run("report", store, "--out", out, "--compare", "1", "2", "--to", "3")[0] == 2
    assert run("report", store, "--out", out, "--from", "yesterday")[0] == 2
    assert run("report", store, "--out", out, "--region", "30,30,40,40") == (
        2, "microrelief: the region holds no cell: the height map reaches from -5.00 to 5.00 mm in x and "
        "from -5.00 to 5.00 mm in y\n",
    )  # fmt: skip
    code, told = run("movie", store, "--out", str(tmp_path / "a.gif"), "--frames", "3", "--width", "300")
    assert (code, "3 frames, 0.2 s" in told) == (0, True)
    assert run("movie", store, "--out", str(tmp_path / "a.avi"))[1].endswith("a film is .mp4 or .gif\n")
    assert run("movie", store, "--fps", "0")[0] == 2


def test_pictures_of_a_page_can_be_opened(written: Path) -> None:
    text = (written / "report.html").read_text("utf-8")
    for part in text.split("data:image/png;base64,")[1:]:
        Image.open(io.BytesIO(base64.b64decode(part.partition('"')[0]))).verify()
