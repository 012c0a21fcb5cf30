"""TI's projectors: every byte against what others send, and the order of things against stand-ins for the devices.

There is no public emulator of either controller. The packets of the DLPC350 are compared with those that PyPI's
pycrafter4500 sends; the commands of the DLPC3478 with what TI's own Python library (`dlpc34xx`, sample code of DLPC-API
1.12) packs for the same calls, written down here. How a device answers is our reading of the programmer's guides.
"""

from __future__ import annotations

import struct
import sys
import types
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from configs import CaptureError, DeviceUnavailable, InputError
from monitor.rigs import DevicesRig, make_rig
from monitor.rigs.cameras import FrameLost, Shot
from monitor.rigs.projectors import PROJECTORS
from monitor.rigs.projectors import dlpc350_packets as packets
from monitor.rigs.projectors import dlpc3478_commands as commands
from pipelines import PatternSet, parse_instant

from .peers import need

NOW = parse_instant("2026-11-22T21:00:00Z")
FULL = PatternSet("gray", (912, 1140), bits=(10, 10))


@pytest.fixture
def theirs(monkeypatch: pytest.MonkeyPatch) -> tuple[Any, list[bytes]]:
    """A projector of pycrafter4500, and the reports that it sends."""
    need("pycrafter4500")
    from pycrafter4500 import pycrafter4500 as module

    sent: list[bytes] = []
    usb = types.SimpleNamespace(
        write=lambda endpoint, report: sent.append(bytes(report)), read=lambda endpoint, size: [0] * size
    )
    monkeypatch.setattr(module.time, "sleep", lambda seconds: None)
    return module.dlpc350(usb), sent


def as_reports(*given: bytes) -> list[bytes]:
    return [report for packet in given for report in packets.reports(packet)]


def test_the_packets_of_the_dlpc350_are_those_of_pycrafter4500(theirs: tuple[Any, list[bytes]]) -> None:
    projector, sent = theirs
    ours = list(packets.sequence(42, (3, 5), 20_000, 40_000, "blue"))
    table = ours[12][6:]
    assert len(table) == 3 * 42
    projector.pattern_display("stop")
    projector.set_display_mode("pattern")
    projector.set_pattern_input_source("flash")
    projector.set_pattern_config(42, do_repeat=False, num_pats_for_trig_out2=42, num_images=1)  # 1: two images
    projector.set_pattern_trigger_mode(1)
    projector.set_exposure_frame_period(20_000, 40_000)
    projector.open_mailbox(1)
    projector.mailbox_set_address(0)
    projector.command("w", 0x00, 0x1A, 0x34, [5, 3])  # two images go in reverse, as TI's library has it
    projector.open_mailbox(0)
    projector.open_mailbox(2)
    projector.mailbox_set_address(0)
    projector.command("w", 0x00, 0x1A, 0x34, list(table))  # 132 bytes: over three reports
    projector.open_mailbox(0)
    projector.start_pattern_lut_validate()
    assert as_reports(*ours) == sent
    del sent[:]
    for number in range(42):
        projector.send_pattern_lut(0, number % 24, 1, 4, do_insert_black=True, do_buf_swap=number % 24 == 0)
    assert b"".join(report[6:9] for report in sent) == table
    del sent[:]
    projector.pattern_display("start")
    projector.command("r", 0x00, 0x1A, 0x1A, [])
    assert as_reports(packets.play("start"), packets.read(packets.LUT_CHECK)) == sent


def test_the_commands_of_the_dlpc3478_are_those_of_tis_own_library() -> None:
    ours = [*commands.sequence([[0, 22], [1, 20]], 20_000, 338, 20_000, "blue"), commands.play("start")]
    assert [each.hex() for each in ours] == [
        "9e0100",  # WriteInternalPatternControl(Stop, 0)
        "98010016040000000000000000204e000052010000204e0000",  # WritePatternOrderTableEntry(Start, set 0, 22 patterns)
        "98000114040000000000000000204e000052010000204e0000",  # ... (Continue, set 1, 20 patterns)
        "9000",  # WriteTriggerInConfiguration(Disable, ActiveLow)
        "920300000000",  # WriteTriggerOutConfiguration(Trigger2, Enable, NotInverted, 0)
        "0504",  # WriteOperatingModeSelect(SensInternalPattern)
        "9e0000",  # WriteInternalPatternControl(Start, 0)
    ]
    assert commands.ask_times(20_000).hex() == "9d0100204e0000"  # ReadValidateExposureTime(Internal, OneBitMono, 20000)
    # DLPC347X_ReadValidateExposureTime unpacks bit 0, then three words of 32 bits
    assert commands.read_times(b"\x11" + struct.pack("<III", 700, 338, 60)) == commands.Times(True, 700, 338, 60)


class LightCrafter:
    """Stands in for hidapi's device: keeps what is asked, answers as the guide says."""

    def __init__(self) -> None:
        self.packets: list[bytes] = []
        self.answers: list[int] = [0x80, 0x00]  # busy with its check, then fine
        self.refuses: int | None = None
        self.gone = False
        self._rest = 0

    def open(self, vendor: int, product: int) -> None:
        assert (vendor, product) == (0x0451, 0x6401)
        if self.gone:
            raise OSError("open failed")

    def write(self, report: bytes) -> int:
        assert report[0] == 0
        assert len(report) == 65
        if self.gone:
            return -1
        if self._rest > 0:
            self.packets[-1] += report[1:]
        else:
            self.packets.append(report[1:])
            self._rest = 4 + struct.unpack("<H", report[3:5])[0]
        self._rest -= 64
        return len(report)

    def read(self, size: int, timeout_ms: int) -> list[int]:
        command = self.commands[-1]
        flags = 0x60 if command == self.refuses else 0x40
        status = self.answers.pop(0) if self.packets[-1][0] & 0x80 else 0
        return [flags, 0, 1, 0, 0, 0, status, *[0] * (size - 7)]

    @property
    def commands(self) -> list[int]:
        return [struct.unpack("<H", packet[4:6])[0] for packet in self.packets]

    def close(self) -> None: ...


class Bus:
    """Stands in for the I2C bridge."""

    def __init__(self) -> None:
        self.commands: list[bytes] = []
        self.answer = b"\x01" + struct.pack("<III", 700, 338, 60)
        self.gone = False

    def __enter__(self) -> Bus:
        return self

    def __exit__(self, *_: object) -> None:
        self.commands.append(b"closed")

    def write(self, command: bytes) -> None:
        if self.gone:
            raise DeviceUnavailable("the DLP3010EVM-LC does not take command")
        self.commands.append(command)

    def read(self, command: bytes, length: int) -> bytes:
        self.write(command)
        return self.answer


@pytest.fixture
def crafter(monkeypatch: pytest.MonkeyPatch) -> LightCrafter:
    device = LightCrafter()
    monkeypatch.setitem(sys.modules, "hid", types.SimpleNamespace(device=lambda: device))
    return device


@pytest.fixture
def bus(monkeypatch: pytest.MonkeyPatch) -> Bus:
    bus = Bus()
    monkeypatch.setattr("monitor.rigs.projectors.dlpc3478.I2CBridge", lambda: bus)
    return bus


def test_a_lightcrafter_is_set_up_checked_played_and_stopped(crafter: LightCrafter) -> None:
    projector = PROJECTORS["dlpc350"]()
    with pytest.raises(DeviceUnavailable, match=r"open\(\)"):
        projector.show(0)
    projector.open()
    projector.load(FULL)
    assert crafter.commands[-2:] == [packets.LUT_CHECK] * 2  # asked until it was no longer busy
    count = len(crafter.packets)
    projector.load(FULL)
    projector.show(0)
    projector.show(1)
    assert [packet[:7].hex() for packet in crafter.packets[count:]] == ["40000300241a00", "40000300241a02"]
    projector.close()
    assert crafter.packets[-1][:7].hex() == "40000300241a00"
    projector.close()


def test_what_a_lightcrafter_refuses_is_said(crafter: LightCrafter) -> None:
    projector = PROJECTORS["dlpc350"]()
    projector.open()
    crafter.answers = [0x01]
    with pytest.raises(InputError, match="exposure or period is impossible"):
        projector.load(FULL)
    crafter.refuses = 0x1A29
    with pytest.raises(InputError, match="refuses command 1A29"):
        projector.load(FULL)
    with pytest.raises(InputError, match=r"set patterns\.size to \[912, 1140\]"):
        projector.load(PatternSet("gray", (608, 684), bits=(3, 3)))
    crafter.gone = True
    with pytest.raises(DeviceUnavailable, match="does not answer"):
        projector.show(0)
    projector.close()
    with pytest.raises(DeviceUnavailable, match="no LightCrafter 4500 can be opened"):
        projector.open()


SMALL = PatternSet("gray", (1280, 720), bits=(1, 1))


def test_an_evaluation_module_is_asked_set_up_played_and_stopped(bus: Bus) -> None:
    projector = PROJECTORS["dlpc3478"](sets=[[0, 4], [1, 2]])
    projector.open()
    projector.load(SMALL)
    assert [each[0] for each in bus.commands] == [0x9D, 0x9E, 0x98, 0x98, 0x90, 0x92, 0x05]
    before, after = struct.unpack("<II", bus.commands[2][-8:])
    assert (before, after) == (338, 20_000 - 338)  # as dark as was asked for, and as the controller needs
    del bus.commands[:]
    projector.load(SMALL)
    projector.show(0)
    projector.show(1)
    projector.close()
    assert bus.commands == [commands.play("stop"), commands.play("start"), commands.play("stop"), b"closed"]


def test_what_an_evaluation_module_cannot_is_said(bus: Bus) -> None:
    projector = PROJECTORS["dlpc3478"](sets=[[0, 4], [1, 3]], exposure_ms=0.1)
    projector.open()
    with pytest.raises(InputError, match="they show 7 patterns, and the campaign's pattern set has 6"):
        projector.load(SMALL)
    projector = PROJECTORS["dlpc3478"](sets=[[0, 4], [1, 2]], exposure_ms=0.1)
    projector.open()
    bus.answer = b"\x00" + bus.answer[1:]
    with pytest.raises(InputError, match=r"for 0\.1 ms; the shortest is 0\.7 ms"):
        projector.load(SMALL)


def test_no_module_on_usb_is_a_device_that_is_not_there() -> None:
    need("hid")
    need("cy_serial_bridge")
    for name, options in (("dlpc350", {}), ("dlpc3478", {"sets": [[0, 6]]})):
        with pytest.raises(DeviceUnavailable, match="look at its power and USB cable"):
            PROJECTORS[name](**options).open()


class Triggered:
    """A camera on the projector's line: one frame of each pulse, or none where its number is among the lost."""

    wraps_at: int | None = None
    exposure_ms = 20.0
    awaits_trigger = True

    def __init__(self, lost: set[int]) -> None:
        self.lost, self.pulse = lost, 0

    def open(self) -> None: ...
    def start(self) -> None: ...
    def close(self) -> None: ...

    def take(self) -> Shot:
        self.pulse += 1
        if self.pulse in self.lost:
            raise FrameLost("no frame came")
        return Shot(np.full((4, 5), self.pulse, np.uint8))


Make = Callable[[set[int]], DevicesRig]


@pytest.fixture
def playing(bus: Bus) -> Make:
    def make(lost: set[int]) -> DevicesRig:
        camera = {"kind": "basler", "trigger": "Line1"}
        rig = DevicesRig(camera=camera, projector={"kind": "dlpc3478", "sets": [[0, 4], [1, 2]]}, retries=1)
        rig.camera = Triggered(lost)
        rig.open()
        return rig

    return make


def test_a_lost_frame_of_a_projector_that_plays_by_itself_costs_the_whole_capture(playing: Make, bus: Bus) -> None:
    rig = playing({3})
    frames = rig.capture(SMALL, NOW)
    assert [int(frame[0, 0]) for frame in frames.stack] == [4, 5, 6, 7, 8, 9]  # pulses 1 to 3 were thrown away
    assert bus.commands.count(commands.play("start")) == 2
    (remark,) = frames.remarks
    assert remark.startswith(f"the capture was taken again: frame 2 ({SMALL.roles[2].name})")


def test_a_capture_that_fails_again_is_a_capture_error(playing: Make) -> None:
    with pytest.raises(CaptureError, match=r"frame 1 .*no frame came"):
        playing({2, 4}).capture(SMALL, NOW)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"projector": {"kind": "dlpc350"}}, "wire that to the camera's trigger input, and name it"),
        ({"projector": {"kind": "dlpc350", "led": "uv"}}, "led must be one of red, green, blue, white"),
        ({"projector": {"kind": "dlpc350", "dark_ms": 0.1}}, "must be dark for 230 us"),
        ({"projector": {"kind": "dlpc3478", "sets": [[0, 99]]}}, "sets must be pairs"),
    ],
)
def test_wrong_options_are_one_clear_line(options: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        make_rig("devices", {"camera": {"kind": "basler"}, **options})
