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
    context = browser.new_context(color_scheme="dark" if scheme == "dark" else "light")
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
    assert len(shown) == 14  # six trends, the level of detection, six maps, and the map of rates
    assert all(across > 250 and down > 100 for across, down in shown)
    pictures = page.evaluate(
        "Promise.all([...document.querySelectorAll('svg image')].map(i => new Promise(done => {"
        "const p = new Image(); p.onload = () => done(p.naturalWidth); p.onerror = () => done(0);"
        "p.src = i.getAttribute('href')})))"
    )
    assert pictures == [60] * 6 + [8], "the rates are of 8x8 cells"
    context.close()
