"""The report as a browser shows it: in light, in dark, on a telephone, without a network."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from dashboards import write_report

from ..chromium import chromium, needs_chromium
from .drying import drying_store

if TYPE_CHECKING:
    from playwright.sync_api import Browser

pytestmark = needs_chromium
AXE = Path(__file__).parents[2] / ".cache/axe-core/node_modules/axe-core/axe.min.js"


@pytest.fixture(scope="module")
def page_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_report(drying_store(6, 60), tmp_path_factory.mktemp("report"))


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as opened:
        yield opened


@pytest.mark.parametrize("width", [390, 1280])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_page_fits_and_follows_the_scheme(browser: Browser, page_file: Path, scheme: str, width: int) -> None:
    context = browser.new_context(color_scheme="dark" if scheme == "dark" else "light", offline=True)
    page = context.new_page()
    asked: list[str] = []
    wrong: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.on("console", lambda message: wrong.append(message.text))
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.set_viewport_size({"width": width, "height": 900})
    page.goto(page_file.as_uri())

    assert wrong == []
    assert [url for url in asked if not url.startswith(("file:", "data:"))] == []
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    paper = page.evaluate("getComputedStyle(document.body).backgroundColor")
    brightness = sum(int(part) for part in paper.removeprefix("rgb(").removesuffix(")").split(",")) / 3
    assert (brightness < 60) if scheme == "dark" else (brightness > 200)
    shown = page.evaluate(
        "[...document.querySelectorAll('figure canvas, figure svg.map')]"
        ".map(s => s.getBoundingClientRect()).map(b => [b.width, b.height])"
    )
    assert len(shown) == 15  # six trends, the level of detection, six maps, the map of rates, and the camera's picture
    assert all(across > 250 and down > 100 for across, down in shown)
    pictures = page.evaluate(
        "Promise.all([...document.querySelectorAll('svg image')].map(i => new Promise(done => {"
        "const p = new Image(); p.onload = () => done(p.naturalWidth); p.onerror = () => done(0);"
        "p.src = i.getAttribute('href')})))"
    )
    assert pictures == [60] * 7 + [8], "the rates are of 8x8 cells"
    context.close()


def test_zooming_one_chart_zooms_all_and_a_double_click_shows_everything(browser: Browser, page_file: Path) -> None:
    page = browser.new_page(viewport={"width": 1280, "height": 900})
    page.goto(page_file.as_uri())
    overs = page.locator(".u-over")
    assert page.locator("figure.live svg.chart").first.is_hidden()
    ticks = "[...document.querySelectorAll('.plot canvas')].map(c => c.toDataURL())"
    whole = page.evaluate(ticks)
    overs.nth(1).scroll_into_view_if_needed()
    box = overs.nth(1).bounding_box()
    assert box is not None
    for share, press in ((0.3, page.mouse.down), (0.6, page.mouse.up)):
        page.mouse.move(box["x"] + share * box["width"], box["y"] + 40)
        press()
    page.mouse.move(box["x"] + 0.9 * box["width"], box["y"] + 40)
    page.wait_for_timeout(100)
    zoomed = page.evaluate(ticks)
    assert all(before != after for before, after in zip(whole, zoomed, strict=True))
    readouts = page.locator(".readout").all_inner_texts()
    assert sum("UTC" in text for text in readouts) == len(whole), "the cursor stands in all of them"
    overs.nth(1).dblclick()
    page.get_by_role("heading", name="Trends").hover()
    page.wait_for_timeout(100)
    assert page.evaluate(ticks)[0] == whole[0]
    page.get_by_role("button", name="Closer").press("Enter")
    page.wait_for_timeout(100)
    assert page.evaluate(ticks)[0] != whole[0]
    page.close()


def test_on_paper_and_without_scripts_the_drawings_stand_where_the_charts_were(
    browser: Browser, page_file: Path
) -> None:
    page = browser.new_page(color_scheme="dark")
    page.goto(page_file.as_uri())
    page.emulate_media(media="print")
    assert page.locator("svg.chart").first.is_visible()
    assert page.locator(".plot").first.is_hidden()
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
    page.close()
    context = browser.new_context(java_script_enabled=False)
    plain = context.new_page()
    plain.goto(page_file.as_uri())
    assert plain.locator("svg.chart").first.is_visible()
    context.close()


@pytest.mark.parametrize("scheme", ["light", pytest.param("dark", marks=pytest.mark.soak)])
def test_nothing_keeps_people_from_reading_it(browser: Browser, page_file: Path, scheme: str) -> None:
    if not AXE.exists():
        pytest.skip("needs axe-core: npm, and .ci/node-packages")
    context = browser.new_context(color_scheme="dark" if scheme == "dark" else "light", bypass_csp=True)
    page = context.new_page()
    page.goto(page_file.as_uri())
    page.evaluate(AXE.read_text(encoding="utf-8"))
    found = page.evaluate("axe.run({resultTypes: ['violations']})")
    assert found["passes"]
    grave = [each["id"] for each in found["violations"] if each["impact"] in ("serious", "critical")]
    assert grave == []
    context.close()
