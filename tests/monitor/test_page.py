"""The status page: what it says, whom it answers, what no request can make it do."""

from __future__ import annotations

import base64
import json
import re
import socket
import urllib.request
from dataclasses import replace
from pathlib import Path
from urllib.parse import urljoin, urlsplit

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from prometheus_client.parser import text_string_to_metric_families
from starlette.testclient import TestClient
from starlette.types import ASGIApp, Receive, Scope, Send

from configs import InputError
from monitor.campaign import run_campaign
from monitor.cli import run_tokens
from monitor.clock import AcceleratedClock
from monitor.health_log import HealthLog, health_file
from monitor.page import PageServer, Reviews, Sites, SiteSource, make_app
from monitor.page.guard import TOKEN
from pipelines import Event, Tick, instant
from storage import open_store

from . import campaigns
from .stored import START, at, fill

NOW = START + np.timedelta64(30, "D")
LOCAL = "http://127.0.0.1:8123"
HERE = ("127.0.0.1", 50000)


@pytest.fixture(scope="module")
def stores(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("sites")
    paths = [folder / "north.icechunk", folder / "south.icechunk"]
    fill(paths[0], 5).close()
    fill(paths[1], 1).close()
    store = open_store(paths[1], write=True)
    store.append(Tick(at(9), events=(Event(at(9), "failed", "<script>alert('x')</script> & more"),)))
    store.close()
    return paths


class NoReviews(Reviews):
    """Notes what it is asked for, and starts nothing."""

    def __init__(self) -> None:
        super().__init__()
        self.asked: list[str] = []

    def start(self, key: str, store: str | Path) -> None:
        self.asked.append(key)


def sites(stores: list[Path]) -> Sites:
    missing = stores[0].with_name("none.icechunk")
    return Sites([SiteSource(path) for path in (*stores, missing)], lambda: NOW)


@pytest.fixture(scope="module")
def client(stores: list[Path]) -> TestClient:
    return TestClient(make_app(sites(stores), NoReviews()), base_url=LOCAL, client=HERE)


def test_the_fleet_is_on_one_page(client: TestClient) -> None:
    answer = client.get("/")
    assert answer.status_code == 200
    for key in ("north", "south", "none"):
        assert f'href="site/{key}"' in answer.text
    assert "no store yet: the first scan makes it" in answer.text
    assert answer.text.count('class="verdict') == 3


def test_a_site_says_state_scans_trends_and_events(client: TestClient) -> None:
    text = client.get("/site/north").text
    assert ">5<" in text
    assert text.count("<svg") == 4, "height, change and two trends"
    assert "Volume gained" in text
    assert "block: ok -&gt; warning" in text
    assert "<h2>block: warning</h2>" in text
    assert 'src="north/picture.png?scan=4"' in text


def test_what_a_device_said_is_text_and_no_markup(client: TestClient) -> None:
    text = client.get("/site/south").text
    assert "<script" not in text
    assert "&lt;script&gt;alert(&#39;x&#39;)&lt;/script&gt; &amp; more" in text


def test_one_site_alone_is_the_first_page(stores: list[Path]) -> None:
    alone = TestClient(make_app(Sites([SiteSource(stores[0])], lambda: NOW), NoReviews()), base_url=LOCAL)
    assert alone.get("/").url.path == "/site/north"


class Stripped:
    """What a proxy does that serves an application under a path."""

    def __init__(self, app: ASGIApp, prefix: str) -> None:
        self._app, self._prefix = app, prefix

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "http":
            assert scope["path"].startswith(f"{self._prefix}/"), scope["path"]
            path = scope["path"].removeprefix(self._prefix)
            scope = {**scope, "path": path, "raw_path": path.encode()}
        await self._app(scope, receive, send)


@pytest.mark.parametrize("many", [True, False])
def test_every_link_holds_under_a_proxys_path(stores: list[Path], many: bool) -> None:
    shown = sites(stores) if many else Sites([SiteSource(stores[0])], lambda: NOW)
    app = make_app(shown, NoReviews())
    client = TestClient(Stripped(app, "/rigs"), base_url=LOCAL, client=HERE)
    todo, seen = [f"{LOCAL}/rigs/", f"{LOCAL}/rigs/site/nowhere", f"{LOCAL}/rigs/a/b/c/d"], set[str]()
    while todo:
        asked = todo.pop()
        answer = client.get(asked)
        assert answer.status_code == (404 if asked.endswith(("nowhere", "/d")) else 200), asked
        seen.add(asked)
        if "html" in answer.headers["content-type"]:
            links = re.findall(r'(?:href|src|action)="([^"]*)"', answer.text)
            found = {urljoin(str(answer.url), link) for link in links if not link.startswith("data:")}
            todo += sorted(found - seen - set(todo))
    names = {urlsplit(one).path.removeprefix("/rigs") for one in seen}
    assert {"/", "/style.css", "/site/north", "/site/north/picture.png", "/site/north/review"} <= names


def test_who_is_elsewhere_is_not_led_to_a_review_that_opens_here(stores: list[Path]) -> None:
    app = make_app(sites(stores), NoReviews())
    far = TestClient(app, base_url=LOCAL, client=("192.0.2.7", 50000))
    near = TestClient(app, base_url=LOCAL, client=HERE)
    for answer in (far.get("/site/north"), near.get("/site/north", headers={"x-forwarded-for": "192.0.2.7"})):
        assert "<form" not in answer.text
        assert "opens on the rig itself" in answer.text
    assert "<form" in near.get("/site/north").text


def test_the_picture_is_a_picture(client: TestClient) -> None:
    answer = client.get("/site/north/picture.png")
    assert answer.headers["content-type"] == "image/png"
    assert answer.content.startswith(b"\x89PNG")
    assert client.get("/site/none/picture.png").status_code == 404


def test_the_state_is_that_of_the_command(
    client: TestClient, stores: list[Path], capsys: pytest.CaptureFixture[str]
) -> None:
    run_tokens(["status", str(stores[0]), "--json"])
    command = json.loads(capsys.readouterr().out)
    page = client.get("/site/north/status.json").json()
    assert {name: page[name] for name in ("scans", "last", "state", "alarms")} == {
        name: command[name] for name in ("scans", "last", "state", "alarms")
    }
    assert client.get("/site/none/status.json").status_code == 503


def test_prometheus_reads_the_metrics(client: TestClient) -> None:
    families = {family.name: family for family in text_string_to_metric_families(client.get("/metrics").text)}
    slots = {(s.labels["site"], s.labels["state"]): s.value for s in families["microrelief_slots"].samples}
    assert slots["north", "taken"] == 5
    last = {s.labels["site"]: s.value for s in families["microrelief_last_scan_timestamp_seconds"].samples}
    assert last["north"] == float(at(4).astype("datetime64[s]").astype(int))
    states = [(s.labels["site"], s.labels["state"]) for s in families["microrelief_state"].samples if s.value]
    assert ("none", "unknown") in states
    alarms = {s.labels["alarm"]: s.value for s in families["microrelief_alarm"].samples if s.labels["site"] == "north"}
    assert alarms["block"] == 1, "a warning"
    assert all(name.startswith("microrelief_") for name in families)


def test_the_page_says_how_late_the_newest_visit_began_and_what_was_dropped(tmp_path: Path) -> None:
    campaign = campaigns.campaign_in(tmp_path)
    clock = AcceleratedClock(instant(campaigns.BASE))
    run_campaign(campaign, clock=clock, rig=campaigns.Rig(), max_scans=2, work=campaigns.work)
    log = HealthLog(health_file(campaign))
    log.add(replace(log.newest(1)[0], lag_s=1.25, latency_s=2.5))
    log.add_dropped(3)
    alone = Sites([SiteSource(campaign.store.path, campaign)], clock.now)
    client = TestClient(make_app(alone, NoReviews()), base_url=LOCAL)
    told = "newest began 1.250 s late, worked out after 2.50 s; of the newest 5 slots 3 were dropped"
    assert f"<tr><th>Slots</th><td>{told}</td></tr>" in client.get("/site/site").text
    assert client.get("/site/site/status.json").json()["prompt"]["dropped"] == 3
    families = {family.name: family for family in text_string_to_metric_families(client.get("/metrics").text)}
    assert families["microrelief_lag_seconds"].samples[0].value == 1.25
    assert families["microrelief_latency_seconds"].samples[0].value == 2.5


def test_health_is_plain(client: TestClient) -> None:
    assert client.get("/healthz").text == "alive\n"
    assert client.get("/livez").status_code == 200
    assert client.get("/readyz").text == "not ready: none\n"


def test_a_review_is_begun_by_a_form_of_this_page_only(stores: list[Path]) -> None:
    reviews = NoReviews()
    client = TestClient(make_app(sites(stores), reviews), base_url=LOCAL, follow_redirects=False)
    assert client.get("/site/north/review").status_code == 200
    assert reviews.asked == [], "looking starts nothing"
    assert client.post("/site/north/review", headers={"origin": "https://elsewhere.example"}).status_code == 403
    assert client.post("/site/north/review", headers={"origin": LOCAL}).headers["location"] == "review"
    assert client.post("/site/none/review").status_code == 409
    assert reviews.asked == ["north"]


def test_another_name_for_this_machine_gets_nothing(client: TestClient) -> None:
    for name in ("evil.example", "evil.example:8123", "127.0.0.1.evil.example", "localhost@evil.example"):
        assert client.get("/metrics", headers={"host": name}).status_code == 421
    for name in ("localhost:8123", "127.0.0.1", "[::1]:8123"):
        assert client.get("/healthz", headers={"host": name}).status_code == 200


def test_the_page_loads_nothing_from_elsewhere_and_runs_no_script(client: TestClient) -> None:
    answer = client.get("/site/north")
    assert "default-src 'none'" in answer.headers["content-security-policy"]
    assert "script" not in answer.text
    assert "http://" not in answer.text.replace("http://www.w3.org", "")


def test_a_page_that_is_open_to_others_asks_for_its_token(stores: list[Path]) -> None:
    app = make_app(sites(stores), NoReviews(), host="0.0.0.0", token="open sesame, please")
    client = TestClient(app, base_url="http://rig.example")
    answer = client.get("/")
    assert answer.status_code == 401
    assert answer.headers["www-authenticate"].startswith("Basic")
    assert client.get("/healthz").status_code == 200
    for kind, word in (("Bearer", "open sesame, please"), ("Basic", "")):
        given_ = word or base64.b64encode(b"anybody:open sesame, please").decode()
        assert client.get("/", headers={"authorization": f"{kind} {given_}"}).status_code == 200
    for wrong in ("Bearer no", "Basic !!!", "Basic " + base64.b64encode(b"a:b").decode(), "Bearer"):
        assert client.get("/", headers={"authorization": wrong}).status_code == 401


def test_no_page_is_opened_to_others_without_a_token(stores: list[Path], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(TOKEN, raising=False)
    with pytest.raises(InputError, match=f"opens the page to others: set {TOKEN}"):
        PageServer([SiteSource(stores[0])], host="0.0.0.0", port=0)
    monkeypatch.setenv(TOKEN, "short")
    with pytest.raises(InputError, match="at least 16 characters"):
        PageServer([SiteSource(stores[0])], host="0.0.0.0", port=0)


def test_the_server_listens_on_this_machine_alone(stores: list[Path]) -> None:
    import psutil

    with PageServer([SiteSource(stores[0])], port=0) as server:
        with urllib.request.urlopen(f"{server.link}healthz", timeout=30) as answer:
            assert answer.read() == b"alive\n"
        listening = [c.laddr for c in psutil.Process().net_connections("tcp") if c.status == psutil.CONN_LISTEN]
        assert [address.ip for address in listening if address.port == server.port] == ["127.0.0.1"]
    with socket.socket() as probe:
        assert probe.connect_ex(("127.0.0.1", server.port)) != 0, "it has ended"


def test_a_port_that_is_taken_is_said(stores: list[Path], capsys: pytest.CaptureFixture[str]) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert run_tokens(["serve", str(stores[0]), "--port", str(port)]) == 1
    assert f"port {port} of 127.0.0.1 cannot be used" in capsys.readouterr().err


def test_what_is_no_store_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_tokens(["serve", str(tmp_path / "nothing")]) == 2
    assert "no store there" in capsys.readouterr().err


words = st.text(st.characters(exclude_categories=["Cs"]), max_size=12)
known = st.sampled_from(
    [
        "",
        "site",
        "north",
        "south",
        "none",
        "picture.png",
        "status.json",
        "review",
        "metrics",
        "style.css",
        "healthz",
        "..",
    ]
)
paths = st.lists(known | words, max_size=5).map(lambda parts: "/" + "/".join(parts).lstrip("/"))


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    path=paths,
    query=st.dictionaries(words, words, max_size=3),
    method=st.sampled_from(["GET", "HEAD", "POST", "PUT", "DELETE", "OPTIONS", "PATCH", "TRACE"]),
    header=st.dictionaries(
        st.sampled_from(["host", "authorization", "origin", "accept", "range", "content-type"]),
        st.text(st.characters(min_codepoint=32, max_codepoint=126), max_size=20),
        max_size=2,
    ),
    body=st.binary(max_size=40),
)
def test_no_request_makes_it_fall_over(
    client: TestClient, path: str, query: dict[str, str], method: str, header: dict[str, str], body: bytes
) -> None:
    from urllib.parse import quote

    answer = client.request(method, quote(path), params=query, headers=header, content=body, follow_redirects=False)
    assert answer.status_code < 500 or answer.status_code == 503, f"{method} {path}: {answer.status_code}"
    assert "Traceback" not in answer.text
