"""Notifications: told once when it begins and once when it is over, by mail and by web, and harmless when they fail."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from dataclasses import replace
from email import message_from_bytes
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from configs import Campaign, DeviceUnavailable, InputError, Notify
from monitor.campaign import run_campaign
from monitor.check import load_checked
from monitor.cli import run_tokens
from monitor.clock import AcceleratedClock
from monitor.conditions import Standing, changes
from monitor.notify import Notifier, Targets, outbox_file, read_targets
from monitor.outbox import RETRY_S, Outbox
from monitor.visit import Epoch, Recipe, Yield
from pipelines import AlarmState, Event, Frames, Instant, instant
from pipelines.trends import Watch
from storage import open_store

from . import campaigns
from .campaigns import BASE, Rig, campaign_in
from .stand_ins import whole

T0 = instant(BASE)
HOUR = np.timedelta64(3600 * 10**9, "ns")
SECRET = "hunter2-in-plain-sight"


class Sink:
    """A web server that keeps what it is sent, and may refuse."""

    def __init__(self) -> None:
        self.bodies: list[dict[str, Any]] = []
        self.refuse = False
        sink = self

        class Handler(BaseHTTPRequestHandler):
            def do_POST(self) -> None:
                body = self.rfile.read(int(self.headers["Content-Length"]))
                self.send_response(500 if sink.refuse else 200)
                self.end_headers()
                if not sink.refuse:
                    sink.bodies.append(json.loads(body))

            def log_message(self, *words: object) -> None:
                pass

        self.server = HTTPServer(("127.0.0.1", 0), Handler)
        self.url = f"json://user:{SECRET}@127.0.0.1:{self.server.server_port}/hook"
        self.thread = threading.Thread(target=self.server.serve_forever, kwargs={"poll_interval": 0.02})
        self.thread.start()

    @property
    def titles(self) -> list[str]:
        return [body["title"] for body in self.bodies]

    def close(self) -> None:
        self.server.shutdown()
        self.server.server_close()
        self.thread.join()


@pytest.fixture
def sink() -> Iterator[Sink]:
    made = Sink()
    yield made
    made.close()


def notified(folder: Path, **keys: Any) -> Campaign:
    plain = campaign_in(folder).model_dump(by_alias=True, exclude_unset=True)
    alarm = {"name": "rise", "metric": "net_volume", "alarm_above": 1.0}
    rule = {"env": "MICRORELIEF_TEST_NOTIFY", **keys}
    return Campaign.model_validate({**plain, "alarms": [alarm], "notify": [rule]}, context={"folder": folder})


def run(folder: Path, story: str, at_h: int = 0, **keys: Any) -> None:
    """Run a visit for each letter: o a good scan, a in alarm, n no data, u unplugged, x a scan that gives no map."""

    class Scripted(Rig):
        def capture(self, patterns: object, at: Instant) -> Frames:
            if story[visit(at)] == "u":
                raise DeviceUnavailable("the camera does not answer")
            return super().capture(patterns, at)

    def visit(at: Instant) -> int:
        return int((at - T0) / HOUR) - at_h

    @whole
    def work(frames: Frames, recipe: Recipe, epoch: Epoch | None, planned: Instant) -> Yield:
        letter = story[visit(planned)]
        if letter == "x":
            raise ValueError("too dark")
        made = campaigns.work(frames, recipe, epoch, planned)
        states: dict[str, AlarmState] = {"o": "ok", "a": "alarm", "n": "no data"}
        event = Event(frames.time, "alarm", "rise: ok -> alarm, net volume (1.31 ± 0.02) mm3")
        events = (event,) if letter == "a" else ()
        return replace(
            made,
            tick=replace(made.tick, alarms={"rise": states[letter]}, events=events),
            watches={"rise": Watch(states[letter])},
        )

    clock = AcceleratedClock(T0 + at_h * HOUR)
    run_campaign(notified(folder, **keys), clock=clock, rig=Scripted(), work=work, max_scans=len(story))


@pytest.fixture
def addressed(sink: Sink, monkeypatch: pytest.MonkeyPatch) -> Sink:
    monkeypatch.setenv("MICRORELIEF_TEST_NOTIFY", f"# who is called\n{sink.url}\n")
    return sink


def test_each_thing_is_told_once_when_it_begins_and_once_when_it_is_over(addressed: Sink, tmp_path: Path) -> None:
    run(tmp_path, "oaaaonnouuoxxxo")
    assert addressed.titles == [
        "stand-in: alarm: rise",
        "stand-in: back to normal, alarm: rise",
        "stand-in: no data: rise",
        "stand-in: back to normal, no data: rise",
        "stand-in: device gone",
        "stand-in: not taken",
        "stand-in: back to normal, device gone",
        "stand-in: back to normal, not taken",
        "stand-in: not taken",
        "stand-in: back to normal, not taken",
    ]
    first, second = addressed.bodies[:2]
    assert "net volume (1.31 ± 0.02) mm3" in first["message"]
    assert "it lasted 3 h" in second["message"]
    assert "too dark" in addressed.bodies[-2]["message"]


def test_a_restart_does_not_tell_again(addressed: Sink, tmp_path: Path) -> None:
    run(tmp_path, "oa")
    run(tmp_path, "aao", at_h=2)
    assert addressed.titles == ["stand-in: alarm: rise", "stand-in: back to normal, alarm: rise"]


def test_only_what_was_asked_for_is_told(addressed: Sink, tmp_path: Path) -> None:
    run(tmp_path, "oaouuo", on=["device gone"])
    assert addressed.titles == ["stand-in: device gone", "stand-in: back to normal, device gone"]


def test_a_lasting_alarm_is_told_again_where_that_is_wanted(addressed: Sink, tmp_path: Path) -> None:
    run(tmp_path, "aaaaaa", remind="3 h")
    assert addressed.titles == ["stand-in: alarm: rise", "stand-in: still alarm: rise"]


def test_a_failing_server_harms_no_visit_is_recorded_and_gets_the_message_later(
    addressed: Sink, tmp_path: Path
) -> None:
    addressed.refuse = True
    run(tmp_path, "oaaaaa")
    store = open_store(tmp_path / "site.icechunk")
    assert len(store) == 6
    notes = [event.text for event in store.events if "notification" in event.text]
    assert notes == ["notification not delivered by env MICRORELIEF_TEST_NOTIFY, target 1 (json): will be tried again"]
    addressed.refuse = False
    run(tmp_path, "aa", at_h=30)
    assert addressed.titles.count("stand-in: alarm: rise") == 1, "kept through the restart, and sent once"


def test_no_secret_is_in_anything_that_is_kept_or_said(
    addressed: Sink, tmp_path: Path, capfd: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    addressed.refuse = True
    run(tmp_path, "oauxo")
    assert repr(read_targets(notified(tmp_path).notify[0])).count(SECRET) == 0
    for file in tmp_path.rglob("*"):
        if file.is_file():
            assert SECRET.encode() not in file.read_bytes(), file
    out, err = capfd.readouterr()
    assert SECRET not in out + err + caplog.text


class Mailbox:
    """Keeps mails."""

    def __init__(self) -> None:
        self.mails: list[bytes] = []

    async def handle_DATA(self, server: object, session: object, envelope: Any) -> str:  # noqa: N802 - aiosmtpd's name
        self.mails.append(envelope.content)
        return "250 OK"


def test_mail_arrives(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from aiosmtpd.controller import Controller

    box = Mailbox()
    controller = Controller(box, hostname="127.0.0.1", port=0)
    # the controller asks for its own port to see that it is up, and port 0 is none: take a free one
    import socket

    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        controller.port = probe.getsockname()[1]
    controller.start()
    try:
        url = f"mailto://127.0.0.1:{controller.port}?from=rig@site.example&to=engineer@office.example&mode=insecure"
        monkeypatch.setenv("MICRORELIEF_TEST_NOTIFY", url)
        run(tmp_path, "oa")
    finally:
        controller.stop()
    (mail,) = box.mails
    read = message_from_bytes(mail)
    assert read["To"] == "engineer@office.example"
    assert "alarm: rise" in str(read["Subject"])


def test_a_message_is_given_up_in_the_end_and_that_is_recorded(tmp_path: Path) -> None:
    now = [T0]
    box = Outbox(tmp_path / "outbox.sqlite")
    nowhere = Targets("env NOWHERE", ("json://127.0.0.1:9/",))
    notifier = Notifier("site", [(Notify(env="NOWHERE"), nowhere)], box, lambda _: None, lambda: now[0], threaded=False)
    stands, _ = changes((), (Standing("alarm", "rise", "beyond", T0, T0),), T0, "site", None)
    box.put("env NOWHERE", stands, (), T0)
    for wait in (0, *RETRY_S):
        now[0] = now[0] + np.timedelta64(wait, "s")
        notifier.deliver()
    assert box.counts() == {"waiting": 0, "sent": 0, "given up": 1}
    assert notifier._troubles[-1].endswith(f"given up after {len(RETRY_S) + 1} tries: site: alarm: rise")


@pytest.mark.parametrize("given", ["mailto://me:pw@mail.example", ["json://me:pw@x"], [{"env": "json://me:pw@x"}]])
def test_an_address_in_the_campaign_is_refused_and_not_repeated(
    given: object, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "site.yaml"
    text = (Path(__file__).resolve().parents[2] / "configs" / "soil.yaml").read_text(encoding="utf-8")
    file.write_text(f"{text}\nnotify: {json.dumps(given)}\n", encoding="utf-8")
    assert run_tokens(["run", str(file), "--dry-run"]) == 2
    told = capsys.readouterr().err
    assert "an address must not stand in the campaign" in told
    assert "pw@" not in told


def test_what_cannot_be_sent_to_is_said_before_the_campaign_begins(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("MICRORELIEF_TEST_NOTIFY", raising=False)
    with pytest.raises(InputError, match="the environment variable MICRORELIEF_TEST_NOTIFY is not set"):
        run(tmp_path, "o")
    monkeypatch.setenv("MICRORELIEF_TEST_NOTIFY", f"pigeon://me:{SECRET}@loft")
    with pytest.raises(InputError, match=r"address 1 \(pigeon\) is none that Apprise knows") as error:
        run(tmp_path, "o")
    assert SECRET not in str(error.value)


def test_a_file_that_others_may_read_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "addresses"
    file.write_text("json://127.0.0.1:9/")
    file.chmod(0o644)
    with pytest.raises(InputError, match=r"others may read .*: `chmod 600"):
        read_targets(Notify(file=file))
    file.chmod(0o600)
    assert read_targets(Notify(file=file)).addresses == ("json://127.0.0.1:9/",)


def test_doctor_sends_a_test_message(addressed: Sink, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = (Path(__file__).resolve().parents[2] / "configs" / "soil.yaml").read_text(encoding="utf-8")
    file = tmp_path / "site.yaml"
    file.write_text(f"{text}\nnotify: {{env: MICRORELIEF_TEST_NOTIFY}}\n", encoding="utf-8")
    assert load_checked(file).campaign.notify[0].env == "MICRORELIEF_TEST_NOTIFY"
    run_tokens(["doctor", str(file), "--notify"])
    assert "env MICRORELIEF_TEST_NOTIFY: a test message was delivered" in capsys.readouterr().out
    assert addressed.titles == ["Soil tray 3: test"]
    assert outbox_file(load_checked(file).campaign).exists() is False
