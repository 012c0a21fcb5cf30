"""What every stage keeps, each against a peer that we did not write; and what is each one's own."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from configs import DeviceUnavailable, InputError
from monitor.rigs import STAGES, SimulatedStage, Stage, make_stage
from monitor.rigs.cameras import CAMERAS
from monitor.rigs.parts import make_from_kind
from monitor.rigs.stages.base import check_arrived

from .peers import demo_camera, demo_stage, virtual_printer, virtual_standa


@pytest.fixture(params=list(STAGES))
def options(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[dict[str, Any]]:
    kind = request.param
    if kind == "gcode":
        with virtual_printer() as (port, _):
            yield {"kind": kind, "port": port, "feed_mm_min": 6000.0}
    else:
        peers: dict[str, Callable[[], dict[str, object]]] = {
            "micromanager": demo_stage,
            "simulated": dict,
            "standa": lambda: virtual_standa(tmp_path),
        }
        yield {"kind": kind, **peers[kind]()}


def test_every_stage_goes_where_it_is_sent_and_says_so(options: dict[str, Any]) -> None:
    stage = make_stage(options)
    assert isinstance(stage, Stage)
    with pytest.raises(DeviceUnavailable, match=r"open\(\)"):
        stage.move_to(1.0, 1.0)
    stage.close()
    stage.open()
    stage.open()  # harmless
    for place in ((2.5, -0.75), (0.5, 1.0)):
        stage.move_to(*place)
        assert stage.where() == pytest.approx(place, abs=0.002)  # a step of the coarsest of them
    stage.home()
    if options["kind"] != "micromanager":  # the demonstration stage has no switches: it says yes and stays
        assert stage.where() == pytest.approx((0.0, 0.0), abs=0.002)
    stage.close()
    stage.close()
    stage.open()
    stage.move_to(0.25, 0.0)
    assert stage.where() == pytest.approx((0.25, 0.0), abs=0.002)
    stage.close()


def test_a_printer_that_is_unplugged_is_unavailable() -> None:
    with virtual_printer() as (port, process):
        stage = make_stage({"kind": "gcode", "port": port, "slowest_s": 1.0})
        stage.open()
        process.kill()
        process.wait()
        with pytest.raises(DeviceUnavailable, match="the G-code stage"):
            stage.move_to(1.0, 1.0)
        stage.close()
        with pytest.raises(DeviceUnavailable, match=f"no stage answers at {port}"):
            stage.open()


def test_a_camera_and_a_stage_of_one_configuration_share_its_core(tmp_path: Path) -> None:
    file = tmp_path / "scope.cfg"
    file.write_text(
        "Device,Camera,DemoCamera,DCam\nDevice,XY,DemoCamera,DXYStage\nProperty,Core,Initialize,1\n"
        "Property,Core,Camera,Camera\nProperty,Core,XYStage,XY\n"
    )
    shared = {"configuration": str(file), "adapter_folder": demo_camera()["adapter_folder"]}
    camera = make_from_kind("camera", CAMERAS, {"kind": "micromanager", **shared})
    stage = make_stage({"kind": "micromanager", **shared})
    camera.open()
    stage.open()
    stage.move_to(0.5, 0.5)
    camera.start()
    assert camera.take().image.size
    stage.close()
    assert camera.take().image.size  # the core stays for the camera
    camera.close()


def test_the_simulated_stage_errs_as_it_says_and_always_alike() -> None:
    stage = SimulatedStage(error_mm=0.02)
    stage.open()
    places = np.random.default_rng(0).uniform(-5, 5, (400, 2))
    off = []
    for x, y in places:
        stage.move_to(x, y)
        first = stage.sample_mm
        stage.home()
        assert stage.sample_mm == (0.0, 0.0)
        stage.move_to(x, y)
        assert stage.sample_mm == first
        off.append(np.subtract(first, stage.where()))
    assert np.std(off) == pytest.approx(0.02, rel=0.1)  # 800 draws: 2.5 % of standard error
    with pytest.raises(DeviceUnavailable, match="reaches 50 mm, not 51, 0"):
        stage.move_to(51, 0)


def test_a_stage_that_stands_elsewhere_than_it_was_sent_is_refused() -> None:
    check_arrived("the stage", (1.0, 2.0), (1.04, 2.0))
    with pytest.raises(DeviceUnavailable, match=r"was sent to 1, 2 mm and says that it stands at 1, 1\.9"):
        check_arrived("the stage", (1.0, 2.0), (1.0, 1.9))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"kind": "stander"}, "area.stage: stage name: no stage 'stander', did you mean 'standa'"),
        ({"kind": "gcode"}, "missing 1 required keyword-only argument: 'port'"),
        ({"kind": "standa", "x": "a", "y": "a"}, "two axes, not twice a"),
        ({"kind": "micromanager"}, "give either configuration, or adapter and device"),
    ],
)
def test_wrong_options_are_one_clear_line(options: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        make_stage(options)
