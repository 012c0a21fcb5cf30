"""Temperature and humidity at a visit: from a file that grows, an address, a broker; kept with the scan."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from configs import Environment
from monitor.clock import AcceleratedClock
from monitor.environment import Reading, Sensor, make_sensor, units_of
from monitor.loop import Loop
from monitor.scheduler import IntervalSlots
from pipelines import Instant, Measurement, Tick
from storage import create_store, open_store

from .stand_ins import T0, FakeLedger, FakeRig, after, whole
from .test_alarms import RECIPE, SMALL, Bench, scan_at

BOTH = {"temperature_c": "t", "humidity_percent": "air.rh"}
MINUTE = 60.0


def sensor(**settings: Any) -> Sensor:
    return make_sensor(Environment.model_validate(settings), "Europe/Berlin")


def test_a_logger_s_file_is_interpolated_and_may_grow(tmp_path: Path) -> None:
    file = tmp_path / "air.csv"
    file.write_text("when,note,t,rh\n2026-01-01T00:50:00,x,10,50\n2026-01-01T01:10:00,y,12,60\n")  # Berlin: UTC + 1
    read = sensor(csv=file, time_column="when", temperature_c="t", humidity_percent="rh").read
    assert read(T0) == pytest.approx({"temperature": 11.0, "humidity": 55.0})
    assert read(after(40 * MINUTE)) == pytest.approx({"temperature": 12.0, "humidity": 60.0})
    with pytest.raises(ValueError, match="no line within 60 min"):
        read(after(71 * MINUTE))
    with file.open("a") as lines:
        lines.write("2026-01-01T02:20:00,z,20,\n2026-01-01T02:")  # the humidity sensor died; a line half written
    found = read(after(80 * MINUTE))
    assert found["temperature"] == 20.0
    assert np.isnan(found["humidity"])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("time,x\n", r"air.csv:1: no column 't': it has time, x"),
        ("time,t\nyesterday,3\n", r"air.csv:2: is no time and numbers"),
        ("time,t\n2026-01-01T00:00:00Z,warm\n", r"air.csv:2: is no time and numbers"),
    ],
)
def test_a_file_that_cannot_be_read_says_where(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "air.csv").write_text(text)
    with pytest.raises(ValueError, match=said):
        sensor(csv=tmp_path / "air.csv", temperature_c="t").read(T0)


class Weather(BaseHTTPRequestHandler):
    """Answers with what the test says."""

    answer = b""

    def do_GET(self) -> None:
        self.send_response(200)
        self.end_headers()
        self.wfile.write(Weather.answer)

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002 - the library's name
        pass


@pytest.fixture
def address() -> Iterator[str]:
    server = HTTPServer(("127.0.0.1", 0), Weather)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    yield f"http://127.0.0.1:{server.server_port}/now.json"
    server.shutdown()
    server.server_close()
    thread.join()


def test_an_address_that_answers_with_json(address: str) -> None:
    read = sensor(http=address, **BOTH).read
    Weather.answer = json.dumps({"t": 21.5, "air": {"rh": "48"}}).encode()
    assert read(T0) == {"temperature": 21.5, "humidity": 48.0}
    Weather.answer = b'{"t": 21.5}'
    with pytest.raises(ValueError, match=r"has no field 'air\.rh'"):
        read(T0)
    Weather.answer = b"<html>"
    with pytest.raises(ValueError, match="which is no JSON"):
        read(T0)
    Weather.answer = b"7.25"
    assert sensor(http=address, temperature_c="t").read(T0) == {"temperature": 7.25}


def test_an_address_that_does_not_answer() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        with pytest.raises(OSError, match="refused"):
            sensor(http=f"http://127.0.0.1:{taken.getsockname()[1]}/", **BOTH).read(T0)


@pytest.fixture
def broker() -> Iterator[int]:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = int(free.getsockname()[1])
    command = [sys.executable, "-W", "ignore", "-m", "tests.monitor.mqtt_broker", str(port)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "listening\n"
        yield port
        process.terminate()


def test_a_broker_s_newest_message(broker: int) -> None:
    from paho.mqtt.publish import single

    def publish(content: object) -> None:
        single("site/air", json.dumps(content), qos=1, retain=True, hostname="127.0.0.1", port=broker)

    publish({"t": 18.25, "air": {"rh": 71}})
    listening = sensor(mqtt=f"mqtt://127.0.0.1:{broker}/site/air", timeout_s=20.0, **BOTH)
    with closing(listening):
        listening.open()
        assert listening.read(T0) == {"temperature": 18.25, "humidity": 71.0}
        listening._arrived.clear()  # type: ignore[attr-defined]  # what a later message sets
        publish({"t": 19, "air": {"rh": 70}})
        assert listening.read(T0) == {"temperature": 19.0, "humidity": 70.0}
    silent = sensor(mqtt=f"mqtt://127.0.0.1:{broker}/nobody", timeout_s=0.01, **BOTH)
    with closing(silent):
        silent.open()
        with pytest.raises(ValueError, match=r"no message yet|no connection"):
            silent.read(T0)


class Script:
    """A sensor that gives what the test says."""

    def __init__(self, values: list[float | None]) -> None:
        self.values = values

    def open(self) -> None:
        pass

    def close(self) -> None:
        pass

    def read(self, at: Instant) -> dict[str, float]:
        value = self.values.pop(0)
        if value is None:
            raise OSError("the sensor is gone")
        return {"temperature": value}


SETTINGS = Environment(http="http://127.0.0.1/", temperature_c="t")


def test_trouble_is_told_once_and_its_end_too() -> None:
    reading = Reading(SETTINGS, Script([1.0, None, None, 2.0]))
    ticks = [Tick(after(number), scan_at(after(number))) for number in range(4)]
    assert reading.at(after(0)) == {"temperature": Measurement(1.0, 0.5)}
    told = [reading.beside(tick) for tick in ticks]
    assert [[event.text for event in tick.events] for tick in told] == [
        [],
        ["environment not read: the sensor is gone"],
        [],
        ["environment is read again"],
    ]
    assert told[0].metrics == {"temperature": Measurement(1.0, 0.5)}, "read once for the alarms and the store"
    assert np.isnan(told[1].metrics["temperature"].value)


def test_readings_are_kept_with_every_scan_the_baseline_too(tmp_path: Path) -> None:
    bench = Bench(tmp_path / "unused", [0.0, 0.5, 0.6])
    units = {"net_volume": "mm3", **units_of(SETTINGS)}
    with closing(create_store(tmp_path / "s", site="x", grid=SMALL, metrics=units)) as store:
        from datetime import timedelta

        loop = Loop(
            IntervalSlots(T0, timedelta(hours=1), None),
            lambda slot: 600.0,
            replace(RECIPE, alarms=()),
            FakeRig(),
            store,
            FakeLedger(),
            AcceleratedClock(T0),
            T0 - np.timedelta64(1, "ns"),
            work=whole(bench.work),
            reading=Reading(SETTINGS, Script([20.0, None, 22.0])),
        )
        loop.run(3)
    series = open_store(tmp_path / "s").series()
    np.testing.assert_array_equal(series["temperature"], [20.0, np.nan, 22.0])
    np.testing.assert_array_equal(series["temperature_sigma"], [0.5, np.nan, 0.5])
    assert series.attrs["units"]["temperature"] == "degree_Celsius"
