"""The status page in a browser: on a telephone and a desk, light and dark, without WebGL or network."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from monitor.page import PageServer, SiteSource

from ..chromium import chromium, needs_chromium
from .stored import fill

if TYPE_CHECKING:
    from playwright.sync_api import Browser

SHOTS = os.environ.get("MICRORELIEF_SHOTS")
"""A folder to leave the pictures in, for people to look at."""

pytestmark = needs_chromium


@pytest.fixture(scope="module")
def link(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    folder = tmp_path_factory.mktemp("sites")
    fill(folder / "tray-3.icechunk", 6).close()
    fill(folder / "north-slope.icechunk", 2).close()
    names = ("tray-3", "north-slope", "not-begun")
    with PageServer([SiteSource(folder / f"{name}.icechunk") for name in names], port=0) as server:
        yield server.link


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium("--disable-webgl") as opened:
        yield opened


@pytest.mark.parametrize("width", [390, 1280])
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("path", ["", "site/tray-3", "site/not-begun", "site/nowhere"])
def test_the_page_fits_and_follows_the_scheme(browser: Browser, link: str, path: str, scheme: str, width: int) -> None:
    context = browser.new_context(color_scheme="dark" if scheme == "dark" else "light", java_script_enabled=True)
    page = context.new_page()
    asked: list[str] = []
    wrong: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.on("console", lambda message: wrong.append(message.text))
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.set_viewport_size({"width": width, "height": 900})
    page.goto(link + path)
    if SHOTS is not None:
        name = f"{path.replace('/', '-') or 'fleet'}-{scheme}-{width}.png"
        page.screenshot(path=Path(SHOTS) / name, full_page=True)

    assert [text for text in wrong if "404" not in text] == []
    assert [url for url in asked if not url.startswith((link, "data:"))] == []
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    paper = page.evaluate("getComputedStyle(document.body).backgroundColor")
    brightness = sum(int(part) for part in paper.removeprefix("rgb(").removesuffix(")").split(",")) / 3
    assert (brightness < 60) if scheme == "dark" else (brightness > 200)
    if path == "site/tray-3":
        assert page.evaluate("document.querySelector('figure img').naturalWidth") == 52
        shown = page.evaluate("[...document.querySelectorAll('figure svg')].map(s => s.getBoundingClientRect().width)")
        assert len(shown) == 4
        assert min(shown) > 250
        button = page.evaluate("document.querySelector('button').getBoundingClientRect().height")
        assert button >= 44, "large enough for a finger"
    context.close()


def test_the_fleet_leads_to_a_site(browser: Browser, link: str) -> None:
    page = browser.new_page()
    page.goto(link)
    page.click("text=tray-3" if page.locator("text=tray-3").count() else "a.verdict >> nth=0")
    assert page.url.endswith("/site/tray-3")
    assert page.locator("h2", has_text="Trends").count() == 1
    page.close()


def test_the_review_opens_at_one_click(browser: Browser, link: str) -> None:
    page = browser.new_page()
    page.goto(f"{link}site/tray-3")
    page.click("button")
    page.wait_for_url(lambda url: "?url=rerun" in url, timeout=90_000, wait_until="commit")
    assert page.url.startswith("http://127.0.0.1:")
    page.close()
