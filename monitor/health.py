"""Checks of the machine and of a campaign: what is wrong, and how to mend it."""

from __future__ import annotations

import platform
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass
from importlib import import_module, metadata
from pathlib import Path
from typing import Literal

from configs import Campaign, CaptureError, MicroreliefError, Notify
from pipelines import ENVIRONMENT, PatternSet, unit_text
from storage import network_file_system, open_store, store_exists

from . import __version__
from .alarms import explained
from .campaign import UNTRUSTED
from .clock import RealClock
from .environment import Sensor, make_sensor
from .forecast import bytes_per_scan, format_bytes
from .notify import read_targets, send_test
from .outputs import nearest_there
from .recipe import read_pattern_set, simulated_calibration_file
from .rigs import DevicesRig, Stage, make_rig, make_stage, measure_delay
from .system_libraries import missing_library

__all__ = ["Finding", "check_campaign", "check_delivery", "check_machine"]

LIBRARIES = {
    "numpy": "numpy",
    "numba": "numba",
    "cv2": "opencv-python-headless",
    "sklearn": "scikit-learn",
    "icechunk": "icechunk",
    "zarr": "zarr",
    "rerun": "rerun-sdk",
    "apscheduler": "apscheduler",
    "pydantic": "pydantic",
}
"""Import name and package of what is heavy, compiled, or pinned."""

OURS = ("configs", "pipelines", "storage", "dashboards", "monitor")
LOW_DISK = 2e9
EPOCH_OF_REASON = 1_750_000_000  # June 2025: a clock before this was never set


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that was looked at.

    `level` is ``ok``, ``warning`` or ``wrong``; `mend` says what to do where it is not ok.
    """

    level: Literal["ok", "warning", "wrong"]
    what: str
    told: str
    mend: str = ""


def check_machine() -> Iterator[Finding]:
    """Look at Python, our packages, the libraries, the disk and the clock."""
    yield Finding("ok", "microrelief", f"{__version__} on Python {platform.python_version()}, {platform.system()}")
    yield from _our_names()
    yield from map(_library, LIBRARIES)
    yield _disk(Path.cwd(), "disk here")
    yield _clock()


def check_campaign(campaign: Campaign) -> Iterator[Finding]:
    """Look whether a campaign's rig opens, its calibration is there and its store can be opened and has room."""
    patterns = read_pattern_set(campaign)
    yield from _look_at_rig(campaign, patterns)
    area = campaign.area
    if area is not None:
        yield _try("stage", lambda: _stage_told(make_stage(area.stage)), "see the message")
    file = campaign.calibration.file
    if file is None:
        kept = simulated_calibration_file(campaign, patterns)
        yield Finding("ok", "calibration", f"kept in {kept}" if kept.exists() else "the first run makes it")
    else:
        mend = f"`microrelief calibrate POSE_DIR... --board COLUMNSxROWS --square-mm MM --out {file}`"
        yield _try("calibration", lambda: _read_calibration(file), mend)
    for alarm in campaign.alarms:
        yield Finding("ok", "alarm", explained(alarm, campaign.environment))
    environment = campaign.environment
    if environment is not None:
        mend = "see the message; without it scans go on, and trends are not corrected"
        zone = campaign.site.zone
        yield _try("environment", lambda: _environment_told(make_sensor(environment, zone)), mend)
    store = campaign.store.path
    yield _try("store", lambda: _store_told(store), "see the message; a store that was there: `microrelief status`")
    remote = network_file_system(store)
    if remote is not None:
        yield Finding("warning", "store", f"{store} lies on {remote}", UNTRUSTED)
    size, measured = bytes_per_scan(campaign, patterns)
    yield Finding("ok", "a scan takes", format_bytes(size) + ("" if measured else ", estimated"))
    for rule in campaign.notify:
        mend = "write Apprise URLs there, one a line; `microrelief doctor CAMPAIGN --notify` sends a test message"
        yield _try("notify", lambda rule=rule: _targets_told(rule), mend)  # type: ignore[misc]  # the rule of this turn
    yield _disk(
        nearest_there(campaign.store.beside), "disk of the store" if isinstance(store, Path) else "disk of the ledger"
    )


def check_delivery(campaign: Campaign) -> Iterator[Finding]:
    """Send a test message to everybody whom a campaign notifies."""
    if not campaign.notify:
        yield Finding("warning", "notify", "nobody is told", "give `notify: {env: NAME}` in the campaign")
    for who, failed in send_test(campaign):
        if failed:
            mend = "check the address, and whether this machine reaches that server"
            yield Finding("wrong", "notify", f"{who}: not delivered to {', '.join(failed)}", mend)
        else:
            yield Finding("ok", "notify", f"{who}: a test message was delivered")


def _targets_told(rule: Notify) -> str:
    targets = read_targets(rule)
    return f"{targets.who}: {len(targets.addresses)} addresses"


def _our_names() -> Iterator[Finding]:
    """Our top-level names are generic: another package, or a folder one happens to stand in, may hide them."""
    home = Path(__file__).resolve().parents[1]
    strange = []
    for name in OURS:
        found = getattr(import_module(name), "__file__", None)
        if found is None or Path(found).resolve().parents[1] != home:
            strange.append(f"{name} is {found}")
    if strange:
        mend = "remove or rename that package or folder, or run microrelief from another folder"
        yield Finding("wrong", "packages", "; ".join(strange), mend)
    else:
        yield Finding("ok", "packages", f"{', '.join(OURS)} are ours, in {home}")


def _library(name: str) -> Finding:
    package = LIBRARIES[name]
    try:
        import_module(name)
        return Finding("ok", package, metadata.version(package))
    except ImportError as error:
        told = missing_library(error)
        mend = told[told.find("`") :] if "`" in told else "`pip install --force-reinstall microrelief`"
        return Finding("wrong", package, told.partition(":")[0], mend)
    except OSError as error:  # a shared library that is there and broken
        return Finding("wrong", package, str(error), f"`pip install --force-reinstall {package}`")
    except metadata.PackageNotFoundError:
        return Finding("ok", package, "installed without its metadata")


def _disk(folder: Path, what: str) -> Finding:
    usage = shutil.disk_usage(folder)
    told = f"{format_bytes(usage.free)} free of {format_bytes(usage.total)}"
    if usage.free < LOW_DISK:
        return Finding("warning", what, told, f"free some space below {folder}, or choose another store.path")
    return Finding("ok", what, told)


def _clock() -> Finding:
    now = time.time()
    told = time.strftime("%Y-%m-%d %H:%M:%S UTC", time.gmtime(now))
    if now < EPOCH_OF_REASON:
        return Finding("wrong", "clock", told, "set the clock: `timedatectl set-ntp true`")
    return Finding("ok", "clock", told)


def _try(what: str, look: Callable[[], str], mend: str) -> Finding:
    try:
        return Finding("ok", what, look())
    except TROUBLE as error:
        return _wrong(what, error, mend)


TROUBLE = (MicroreliefError, OSError, ValueError, ImportError)


def _wrong(what: str, error: Exception, mend: str) -> Finding:
    return Finding("wrong", what, missing_library(error) if isinstance(error, ImportError) else str(error), mend)


def _look_at_rig(campaign: Campaign, patterns: PatternSet) -> Iterator[Finding]:
    """Open the rig, once, and measure how late its projector's light follows, where that is ours to measure."""
    try:
        rig = make_rig(campaign.rig.name, campaign.rig.options)
        began = time.perf_counter()
        rig.open()
    except TROUBLE as error:
        yield _wrong("rig", error, "see the message; `microrelief run` would wait for it with code 75")
        return
    with closing(rig):
        yield Finding("ok", "rig", f"{campaign.rig.name} opens in {time.perf_counter() - began:.1f} s")
        if isinstance(rig, DevicesRig) and rig.projector.again == "frame":
            mend = "let the projector alone light what the camera looks at; then give rig option settle_ms"
            yield _try("projector", lambda: _delay_told(rig, patterns), mend)


def _stage_told(stage: Stage) -> str:
    """Hold the stage once, and move nothing."""
    with closing(stage):
        stage.open()
        x, y = stage.where()
    return f"answers, and stands at x {x:g}, y {y:g} mm"


def _delay_told(rig: DevicesRig, patterns: PatternSet) -> str:
    """Measure how late the projector's light follows, beside what the campaign waits."""
    delay = measure_delay(rig, patterns)
    seen = f"its light follows after {delay.least_ms:.0f} to {delay.most_ms:.0f} ms"
    given_ms = rig.settle_s * 1000.0
    if given_ms < delay.most_ms:
        raise CaptureError(f"{seen}, and settle_ms is {given_ms:g}: set rig option settle_ms to {delay.settle_ms:g}")
    return f"{seen}; settle_ms of {given_ms:g} is enough"


def _environment_told(sensor: Sensor) -> str:
    with closing(sensor):
        sensor.open()
        found = sensor.read(RealClock().now())
    return ", ".join(f"{name} {value:g} {unit_text(ENVIRONMENT[name])}" for name, value in found.items())


def _store_told(store: str | Path) -> str:
    if not store_exists(store):
        return f"{store}: the first run makes it"
    count = len(open_store(store))
    return f"{store}: {count} scan{'' if count == 1 else 's'}"


def _read_calibration(file: Path) -> str:
    from pipelines import Calibration

    calibration = Calibration.from_json(file.read_text(encoding="utf-8"))
    return f"{calibration.id}, stereo rms {calibration.rms_px.get('stereo', float('nan')):.3f} px"
