"""Metrics for Prometheus, in base units, made anew at each scrape from how the sites stand."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from prometheus_client import CollectorRegistry, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, InfoMetricFamily, Metric
from prometheus_client.registry import Collector

from pipelines import Instant

from .. import __version__
from .sites import Site, Sites

__all__ = ["exposition"]

STATES = ("ok", "empty", "warning", "degraded", "alarm", "unknown")


class _Collector(Collector):
    def __init__(self, sites: list[Site]) -> None:
        self._sites = sites

    def collect(self) -> Iterator[Metric]:
        """Give every family; a site that cannot be read has its state alone."""
        yield InfoMetricFamily("microrelief_build", "Version.", {"version": __version__})
        state = GaugeMetricFamily("microrelief_state", "1 for the state that a site is in.", labels=["site", "state"])
        for site in self._sites:
            now = site.standing.state if site.standing is not None else "unknown"
            for name in STATES:
                state.add_metric([site.key, name], float(name == now))
        yield state
        slots = CounterMetricFamily("microrelief_slots", "Slots by how they ended.", labels=["site", "state"])
        gauges = {
            "running": "1 while a process writes the store.",
            "overdue_slots": "Slots that nobody answered.",
            "last_scan_timestamp_seconds": "Time of the newest scan.",
            "next_scan_timestamp_seconds": "Next slot.",
            "disk_used_bytes": "Bytes of the store.",
            "disk_free_bytes": "Bytes free on its disk.",
            "disk_full_timestamp_seconds": "When the disk is full at this pace.",
            "lag_seconds": "How late the newest visit began.",
            "latency_seconds": "From the newest visit's slot until its scan was worked out.",
        }
        families = {
            name: GaugeMetricFamily(f"microrelief_{name}", told, labels=["site"]) for name, told in gauges.items()
        }
        alarms = GaugeMetricFamily(
            "microrelief_alarm", "0 ok, 1 warning, 2 alarm, -1 no data.", labels=["site", "alarm"]
        )
        grades = {"ok": 0.0, "warning": 1.0, "alarm": 2.0, "no data": -1.0}
        for site in self._sites:
            standing = site.standing
            if standing is None:
                continue
            for name, count in (
                ("taken", standing.scans),
                ("missed", standing.missed),
                ("rejected", standing.rejected),
                ("failed", standing.failed),
            ):
                slots.add_metric([site.key, name], count)
            values: dict[str, float | Instant | None] = {
                "running": float(standing.running),
                "overdue_slots": float(standing.overdue),
                "last_scan_timestamp_seconds": standing.last,
                "next_scan_timestamp_seconds": standing.next,
                "disk_used_bytes": float(standing.disk_bytes),
                "disk_free_bytes": float(standing.free_bytes),
                "disk_full_timestamp_seconds": standing.disk_full,
                "lag_seconds": standing.prompt.lag_s if standing.prompt is not None else None,
                "latency_seconds": standing.prompt.latency_s if standing.prompt is not None else None,
            }
            for name, value in values.items():
                if value is not None:
                    families[name].add_metric([site.key], _seconds(value))
            for name, grade in standing.alarms.items():
                alarms.add_metric([site.key, name], grades[grade])
        yield slots
        yield from families.values()
        yield alarms


def exposition(sites: Sites) -> bytes:
    """Give the metrics of all sites in Prometheus' text format."""
    registry = CollectorRegistry(auto_describe=False)
    registry.register(_Collector(list(sites)))
    return bytes(generate_latest(registry))


def _seconds(value: float | Instant) -> float:
    if isinstance(value, np.datetime64):
        return float((value - np.datetime64(0, "ns")) / np.timedelta64(1, "s"))
    return float(value)
