"""The review in a browser: filled at both ends of its time line; behind a reverse proxy; of hundreds of scans."""

from __future__ import annotations

import re
import shutil
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import psutil
import pytest
from PIL import Image

from dashboards import cache_folder
from storage import open_store
from tests.chromium import PROGRAM, chromium, needs_chromium
from tests.dashboards.drying import drying_store
from tests.dashboards.filled_store import fill_store
from tests.dashboards.take_screenshot import Picture, coloured, moved, pixels

if TYPE_CHECKING:
    from playwright.sync_api import Page

ROOT = Path(__file__).resolve().parents[2]
NGINX = shutil.which("nginx") or shutil.which("/usr/sbin/nginx")
SITE = "review.example.org", "review-data.example.org"
WEBGL = (
    *("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"),
    "--js-flags=--liftoff-only",  # a page that lives for seconds need not be compiled twice
)
WIDTH, HEIGHT = 900, 560
COLUMNS = {"surface": (slice(0, 440), 0.1), "maps": (slice(460, 670), 0.05), "trends": (slice(690, 900), 0.002)}
"""Where the columns of the preset video lie in such a window, and how much of each is coloured at least."""

MEMORY_LIMIT = 1.5e9
"""Bytes that a browser's tab may hold."""


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return fill_store(drying_store(5, 40), tmp_path_factory.mktemp("campaign") / "plot.icechunk")


def free_ports(count: int) -> int:
    """The first of so many neighbouring ports on which nothing listens now."""
    for _ in range(50):
        probes = [socket.socket() for _ in range(count)]
        try:
            probes[0].bind(("127.0.0.1", 0))
            port: int = probes[0].getsockname()[1]
            for number, probe in enumerate(probes[1:], 1):
                probe.bind(("127.0.0.1", port + number))
        except OSError:
            continue
        finally:
            for probe in probes:
                probe.close()
        return port
    raise AssertionError("no free ports side by side")


@contextmanager
def reviewing(store: Path, port: int, *options: str) -> Iterator[tuple[subprocess.Popen[str], list[str]]]:
    """The command in a process of its own, and the links that it prints."""
    command = [sys.executable, "-m", "monitor.cli", "review", str(store), "--web", "--port", str(port), *options]
    with subprocess.Popen(
        [*command, "--preset", "video"], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    ) as process:
        assert process.stdout is not None
        try:
            count = 2 if "--data-origin" in options else 1
            yield process, [process.stdout.readline().split()[-1 if n else 2] for n in range(count)]
        finally:
            if process.poll() is None:
                process.send_signal(signal.SIGTERM)
                process.wait(timeout=20)


def is_filled(picture: Picture) -> bool:
    """Whether every column of the preset video shows something."""
    return all(coloured(picture[:, at]) >= least for at, least in COLUMNS.values())


def has_moved(now: Picture, before: Picture, share: float = 0.0) -> bool:
    """Whether everything is shown, and more than a share of the surface's view has changed."""
    at = COLUMNS["surface"][0]
    return is_filled(now) and moved(now[:, at], before[:, at]) > share


class Look:
    """A page with a review."""

    def __init__(self, page: Page, folder: Path) -> None:
        self.page = page
        self._folder = folder

    def until(self, shown: Callable[[Picture], bool], name: str, patience_s: float = 90) -> Picture:
        """Give the picture as soon as it shows what it is to show; keep it for people to look at."""
        deadline = time.monotonic() + patience_s
        while not shown(picture := pixels(self.page.screenshot())) and time.monotonic() < deadline:
            self.page.wait_for_timeout(500)
        Image.fromarray(picture).save(self._folder / f"{name}.png")
        return picture

    def go(self, share: float) -> None:
        """Go to a place of the time line, from 0 at its beginning to 1."""
        at, below = 300 + share * (WIDTH - 535), HEIGHT - 13
        self.page.mouse.click(at, below)  # takes the focus first
        self.page.mouse.click(at, below)

    def at_both_ends(self, link: str) -> None:
        """Open a review: all is filled, at the newest scan and at the first, and they differ."""
        self.page.goto(f"{link}&renderer=webgl")
        last = self.until(is_filled, "last")
        assert is_filled(last)
        self.go(0)
        first = self.until(lambda now: has_moved(now, last, 0.01), "first")
        assert has_moved(first, last, 0.01)


@contextmanager
def looking(folder: Path, *flags: str) -> Iterator[Look]:
    """A browser that draws in three dimensions without a card."""
    with chromium(*WEBGL, *flags) as browser:
        page = browser.new_page(viewport={"width": WIDTH, "height": HEIGHT}, ignore_https_errors=True)
        page.set_default_timeout(180_000)
        yield Look(page, folder)


def test_the_web_review_listens_on_this_machine_alone_is_filled_and_ends_with_us(store: Path, tmp_path: Path) -> None:
    port = free_ports(2)
    with reviewing(store, port) as (process, (link,)):
        assert link.startswith(f"http://127.0.0.1:{port}/")
        servers = psutil.Process(process.pid).children()
        sockets = [one for server in servers for one in server.net_connections() if one.status == "LISTEN"]
        assert {(one.laddr.ip, one.laddr.port) for one in sockets} == {("127.0.0.1", port), ("127.0.0.1", port + 1)}
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/", timeout=20) as page:
            assert b"<html" in page.read().lower()
        if PROGRAM is not None:
            with looking(tmp_path) as look:
                look.at_both_ends(link)
        process.send_signal(signal.SIGTERM)
        assert process.wait(timeout=20) == 0
        assert not any(server.is_running() for server in servers)
    assert cache_folder(open_store(store)) == store.with_name("plot.review"), "what was drawn is kept"
    if PROGRAM is None:
        pytest.skip("what it shows needs a browser: apt-get install chromium")


@contextmanager
def proxy(folder: Path, port: int) -> Iterator[int]:
    """Nginx by the blocks that docs/review.md shows, with a certificate of its own; gives its port."""
    shown = re.search(r"^    server \{.*?^    }$\n\n", (ROOT / "docs" / "review.md").read_text(), flags=re.S | re.M)
    assert shown is not None
    outer = free_ports(1)
    servers, here = shown[0], {"443": outer, "127.0.0.1:9090": port, "127.0.0.1:9091": port + 1}
    servers = servers.replace(f"https://{SITE[1]}", f"https://{SITE[1]}:{outer}")
    for documented, ours in here.items():
        assert documented in servers
        servers = servers.replace(documented, f"127.0.0.1:{ours}")
    made = ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj", "/CN=review.example.org"]
    subprocess.run([*made, "-keyout", "key.pem", "-out", "cert.pem"], cwd=folder, check=True, capture_output=True)
    bodies = "".join(
        f"{kind}_temp_path {folder}/{kind};" for kind in ("client_body", "proxy", "fastcgi", "uwsgi", "scgi")
    )
    tls = f"ssl_certificate {folder}/cert.pem; ssl_certificate_key {folder}/key.pem;"
    text = f"daemon off; master_process off; pid {folder}/pid; error_log {folder}/error.log; events {{}} "
    (folder / "nginx.conf").write_text(f"{text} http {{ access_log {folder}/access.log; {bodies} {tls} {servers} }}")
    assert NGINX is not None
    with subprocess.Popen([NGINX, "-c", str(folder / "nginx.conf"), "-e", str(folder / "error.log")]) as running:
        try:
            yield outer
        finally:
            running.terminate()


@pytest.mark.soak
@needs_chromium
@pytest.mark.skipif(NGINX is None, reason="needs a reverse proxy: apt-get install nginx-light")
def test_it_is_filled_behind_a_reverse_proxy_with_tls(store: Path, tmp_path: Path) -> None:
    port = free_ports(2)
    with proxy(tmp_path, port) as outer:
        page, data = (f"https://{name}:{outer}" for name in SITE)
        with (
            reviewing(store, port, "--origin", page, "--data-origin", data) as (_, (_, link)),
            looking(tmp_path, "--host-resolver-rules=MAP *.example.org 127.0.0.1") as look,
        ):
            assert link.startswith(f"{page}/?url=rerun%2Bhttps%3A%2F%2F{SITE[1]}%3A{outer}%2F")
            asked: list[str] = []
            look.page.on("response", lambda response: asked.append(response.url))
            look.at_both_ends(link)
            hosts = {url.split("/")[2] for url in asked if url.startswith("http")}
            assert hosts == {f"{name}:{outer}" for name in SITE}


def tab_memory() -> int:
    """Bytes of its own that the largest tab of our browser holds."""
    held = [0]
    for process in psutil.Process().children(recursive=True):
        try:
            if "--type=renderer" in process.cmdline():
                held.append(process.memory_full_info().uss)
        except psutil.Error:
            continue
    return max(held)


@pytest.mark.soak
@needs_chromium
def test_a_review_of_hundreds_of_scans_stays_within_a_browsers_memory(tmp_path: Path) -> None:
    many = fill_store(drying_store(400, 120), tmp_path / "plot.icechunk")
    with reviewing(many, free_ports(2)) as (_, (link,)), looking(tmp_path) as look:
        look.at_both_ends(link)
        held, now = [tab_memory()], look.until(is_filled, "0")
        for step in range(1, 21):
            look.go(step / 20)
            now = look.until(partial(has_moved, before=now), str(step), 20)
            held.append(tab_memory())
        print(f"tab: {held[0] / 1e9:.2f} GB, at most {max(held) / 1e9:.2f} GB at {len(held)} places of 400 scans")
        assert max(held) < MEMORY_LIMIT
