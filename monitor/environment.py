"""Temperature and humidity at a visit, from a logger's file, an HTTP address or an MQTT broker."""

from __future__ import annotations

import csv
import json
import math
import os
import threading
import time
import urllib.request
from bisect import bisect_left
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol
from urllib.parse import urlsplit
from uuid import uuid4

import numpy as np

from configs import Environment
from pipelines import ENVIRONMENT, Event, Instant, Measurement, Tick, parse_instant

from .extras import load_extra

__all__ = ["SOURCES", "Reading", "Sensor", "make_sensor", "source_of", "units_of"]


class Sensor(Protocol):
    """Where the environment is read; never in a visit's way: what cannot be read is said, and not measured."""

    def open(self) -> None:
        """Begin to listen, where there is something to listen to."""
        ...

    def read(self, at: Instant) -> dict[str, float]:
        """Give the quantities at a time. Raises ValueError or OSError where they cannot be read."""
        ...

    def close(self) -> None:
        """Stop listening."""
        ...


def make_sensor(settings: Environment, zone: str) -> Sensor:
    """Make the sensor that a campaign names; times of its file that name no zone are in `zone`."""
    kind = next(name for name in SOURCES if getattr(settings, name) is not None)
    return SOURCES[kind](settings, zone)


def source_of(settings: Environment) -> str:
    """Where a campaign reads its environment, as people write it."""
    return str(next(where for where in (settings.csv, settings.http, settings.mqtt) if where is not None))


def units_of(settings: Environment | None) -> dict[str, str]:
    """Unit of each quantity that a campaign reads."""
    return {name: ENVIRONMENT[name] for name in settings.fields} if settings is not None else {}


def measured(settings: Environment, values: Mapping[str, float]) -> dict[str, Measurement]:
    """Give readings with the sensor's standard uncertainty; NaN for those that are missing."""
    found = {}
    for name, sigma in settings.sigmas.items():
        value = values.get(name, math.nan)
        found[name] = Measurement(value, sigma if math.isfinite(value) else math.nan)
    return found


class Reading:
    """What a campaign reads at its visits; trouble is told once, until it is over or another."""

    def __init__(self, settings: Environment, sensor: Sensor) -> None:
        self._settings, self._sensor = settings, sensor
        self._trouble = self._told = ""
        self._read: tuple[Instant, dict[str, Measurement]] | None = None

    def at(self, time: Instant) -> dict[str, Measurement]:
        """Give the quantities at a scan's time, NaN where they were not to be had; read once, however often asked."""
        if self._read is None or self._read[0] != time:
            values: dict[str, float] = {}
            self._trouble = ""
            try:
                values = self._sensor.read(time)
            except (ValueError, OSError) as error:
                self._trouble = f"environment not read: {error}"
            self._read = time, measured(self._settings, values)
        return self._read[1]

    def beside(self, tick: Tick) -> Tick:
        """Give a tick with the quantities at its scan, and what to say of them; one without a scan as it is."""
        if tick.scan is None:
            return tick
        time, quantities = tick.scan.time, self.at(tick.scan.time)
        events: tuple[Event, ...] = ()
        if self._trouble != self._told:
            events = (Event(time, "note", self._trouble or "environment is read again"),)
        self._told = self._trouble
        return replace(tick, metrics={**tick.metrics, **quantities}, events=(*tick.events, *events))


class LoggerFile:
    """A file to which a logger adds lines."""

    def __init__(self, settings: Environment, zone: str) -> None:
        assert settings.csv is not None
        self._file: Path = settings.csv
        self._settings, self._zone = settings, zone
        self._seen: tuple[int, int] | None = None
        self._times: list[int] = []
        self._values: dict[str, list[float]] = {}

    def open(self) -> None:
        """Nothing to do: the file is read at each visit, if it has changed."""

    def close(self) -> None:
        """Nothing to do."""

    def read(self, at: Instant) -> dict[str, float]:
        """Interpolate between the lines around a time, or take the nearer one where the other is too far."""
        self._load()
        when, reach = int(at.astype("datetime64[ns]").astype(np.int64)), self._settings.max_age_minutes * 60e9
        after = bisect_left(self._times, when)
        near = [n for n in (after - 1, after) if 0 <= n < len(self._times) and abs(self._times[n] - when) <= reach]
        if not near:
            raise ValueError(f"{self._file}: no line within {self._settings.max_age_minutes:g} min of the scan")
        times = [float(self._times[n] - when) for n in near]
        return {name: float(np.interp(0.0, times, [values[n] for n in near])) for name, values in self._values.items()}

    def _load(self) -> None:
        stat = self._file.stat()
        if self._seen == (stat.st_mtime_ns, stat.st_size):
            return
        columns = {"time": self._settings.time_column, **self._settings.fields}
        rows: list[tuple[int, list[float]]] = []
        with self._file.open(encoding="utf-8-sig", newline="") as lines:
            table = csv.DictReader(lines)
            missing = [column for column in columns.values() if column not in (table.fieldnames or ())]
            if missing:
                known = ", ".join(table.fieldnames or ()) or "none"
                raise ValueError(f"{self._file}:1: no column {missing[0]!r}: it has {known}")
            for line in table:
                try:
                    moment = parse_instant(line[columns["time"]], self._zone)
                    numbers = [float(line[column] or "nan") for column in self._settings.fields.values()]
                except (ValueError, TypeError):
                    if None in line.values():
                        continue  # the logger is writing this line
                    raise ValueError(f"{self._file}:{table.line_num}: is no time and numbers") from None
                rows.append((int(moment.astype(np.int64)), numbers))
        rows.sort(key=lambda row: row[0])
        self._times = [moment for moment, _ in rows]
        self._values = {name: [row[1][n] for row in rows] for n, name in enumerate(self._settings.fields)}
        self._seen = (stat.st_mtime_ns, stat.st_size)


class HttpAddress:
    """An address that answers with the present values as JSON."""

    def __init__(self, settings: Environment, zone: str) -> None:
        assert settings.http is not None
        self._url, self._settings = settings.http, settings

    def open(self) -> None:
        """Nothing to do: each visit asks."""

    def close(self) -> None:
        """Nothing to do."""

    def read(self, at: Instant) -> dict[str, float]:
        """Ask for the present values."""
        with urllib.request.urlopen(self._url, timeout=self._settings.timeout_s) as answer:  # noqa: S310 - http(s) by the campaign's check
            return _fields(answer.read(1_000_000), self._settings.fields, self._url)


class MqttTopic:
    """A topic of a broker; the newest message counts, until it is too old."""

    def __init__(self, settings: Environment, zone: str) -> None:
        assert settings.mqtt is not None
        self._url, self._settings = settings.mqtt, settings
        self._arrived = threading.Event()
        self._message: tuple[float, bytes] | None = None
        self._client: Any = None
        self._trouble = "no message yet"

    def open(self) -> None:
        """Connect in the background, and again whenever the connection breaks."""
        mqtt = load_extra("paho.mqtt.client", "mqtt", "environment.mqtt")
        address = urlsplit(self._url)
        client = mqtt.Client(mqtt.CallbackAPIVersion.VERSION2, client_id=f"microrelief-{uuid4().hex[:12]}")
        if address.scheme == "mqtts":
            client.tls_set()
        user = os.environ.get("MICRORELIEF_MQTT_USER")
        if user:
            client.username_pw_set(user, os.environ.get("MICRORELIEF_MQTT_PASSWORD"))
        topic = address.path.removeprefix("/")

        def connected(client: Any, data: Any, flags: Any, reason: Any, properties: Any) -> None:
            self._trouble = f"refused: {reason}" if reason.is_failure else "no message yet"
            client.subscribe(topic)

        def arrived(client: Any, data: Any, message: Any) -> None:
            if mqtt.topic_matches_sub(topic, message.topic):  # a broker's slip must not become a temperature
                self._message = (time.monotonic(), message.payload)
                self._arrived.set()

        client.on_connect, client.on_message = connected, arrived
        self._trouble = "no connection"
        client.connect_async(address.hostname or "", address.port or (8883 if address.scheme == "mqtts" else 1883))
        client.loop_start()
        self._client = client

    def close(self) -> None:
        """Disconnect."""
        client, self._client = self._client, None
        if client is not None:
            client.disconnect()
            client.loop_stop()

    def read(self, at: Instant) -> dict[str, float]:
        """Give the newest message; the first one is waited for a little."""
        self._arrived.wait(self._settings.timeout_s)
        if self._message is None:
            raise ValueError(f"{self._url}: {self._trouble}")
        when, payload = self._message
        age = (time.monotonic() - when) / 60
        if age > self._settings.max_age_minutes:
            raise ValueError(f"{self._url}: the newest message is {age:.0f} min old")
        return _fields(payload, self._settings.fields, self._url)


SOURCES: dict[str, Callable[[Environment, str], Sensor]] = {
    "csv": LoggerFile,
    "http": HttpAddress,
    "mqtt": MqttTopic,
}
"""By the campaign's key."""


def _fields(text: bytes, fields: Mapping[str, str], source: str) -> dict[str, float]:
    """Take numbers out of JSON; a message that is one number is the one quantity that is asked for."""
    try:
        content = json.loads(text)
    except ValueError:
        raise ValueError(f"{source}: answered {text[:40]!r}, which is no JSON") from None
    if isinstance(content, int | float) and len(fields) == 1:
        return dict.fromkeys(fields, float(content))
    found = {}
    for name, path in fields.items():
        value = content
        for part in path.split("."):
            value = value.get(part) if isinstance(value, dict) else None
        if isinstance(value, bool) or not isinstance(value, int | float | str):
            raise ValueError(f"{source}: has no field {path!r}")
        try:
            found[name] = float(value)
        except ValueError:
            raise ValueError(f"{source}: {path} is {value!r}, not a number") from None
    return found
