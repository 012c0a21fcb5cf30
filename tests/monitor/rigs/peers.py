"""Peers of real drivers that we did not write: emulated cameras, a virtual screen, virtual stages."""

from __future__ import annotations

import contextlib
import fcntl
import importlib.util
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
import pytest

os.environ.setdefault("PYLON_CAMEMU", "1")  # read when pylon is loaded

EMULATED = {"TestImageSelector": "Off", "ImageFileMode": "On"}


def need(module: str) -> None:
    """Skip where a library that is an extra is not installed."""
    if importlib.util.find_spec(module) is None:
        pytest.skip(f"{module} is not installed")


def emulated_basler(folder: Path, images: npt.NDArray[np.uint8]) -> dict[str, object]:
    """Options of a Basler camera that replays images, shape (image, row, column), round and round in this order."""
    need("pypylon")
    folder.mkdir(parents=True)
    for number, image in enumerate(images):
        cv2.imwrite(str(folder / f"{number:04d}.png"), image)
    rows, columns = images.shape[1:]
    size = {"ImageFilename": str(folder), "Width": columns, "Height": rows}
    return {"kind": "basler", "serial": "0815-0000", "features": {**EMULATED, **size}}


def demo_camera(**properties: object) -> dict[str, object]:
    """Options of Micro-Manager's demonstration camera."""
    need("pymmcore")
    need("mm_test_adapters")
    from mm_test_adapters import device_adapter_path

    return {
        "kind": "micromanager",
        "adapter": "DemoCamera",
        "device": "DCam",
        "adapter_folder": str(device_adapter_path()),
        "properties": {"PixelType": "8bit", **properties},
    }


@contextlib.contextmanager
def fake_gige_camera(*options: str) -> Iterator[subprocess.Popen[bytes]]:
    """Run Aravis' fake GigE Vision camera on the loopback; there is one port, so one at a time on this machine."""
    need("gi")
    program = shutil.which("arv-fake-gv-camera-0.8")
    if program is None:
        pytest.skip("arv-fake-gv-camera-0.8 is not installed (Debian: aravis-tools)")
    with (Path(tempfile.gettempdir()) / "microrelief-fake-gige.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        process = subprocess.Popen([program, "-i", "127.0.0.1", *options])
        try:
            yield process
        finally:
            process.kill()
            process.wait()


OCTOPRINT = Path(__file__).parents[3] / ".cache" / "octoprint"


@contextlib.contextmanager
def virtual_printer() -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """Run OctoPrint's virtual printer; give the terminal at which it listens, and its process."""
    need("serial")
    if not (OCTOPRINT / "octoprint").is_dir():
        pytest.skip("OctoPrint is not installed: sh .ci/octoprint")
    process = subprocess.Popen(
        [sys.executable, str(Path(__file__).with_name("virtual_printer.py"))],
        env={**os.environ, "PYTHONPATH": str(OCTOPRINT), "PYTHONWARNINGS": "ignore"},
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stdout is not None
        yield process.stdout.readline().strip(), process
    finally:
        process.kill()
        process.communicate()


def demo_stage() -> dict[str, object]:
    """Options of Micro-Manager's demonstration stage."""
    options = demo_camera()
    return {"adapter": "DemoCamera", "device": "DXYStage", "adapter_folder": options["adapter_folder"]}


def virtual_standa(folder: Path) -> dict[str, object]:
    """Options of two axes of the virtual controller that Standa's library holds."""
    need("libximc")
    return {axis: f"xi-emu:///{folder}/{axis}.bin" for axis in ("x", "y")}


@contextlib.contextmanager
def virtual_screen(columns: int, rows: int, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """Run a virtual X server with one screen, and make it this process' display."""
    need("pygame")
    program = shutil.which("Xvfb")
    if program is None:
        pytest.skip("Xvfb is not installed (Debian: xvfb)")
    reader, writer = os.pipe()
    process = subprocess.Popen(
        [program, "-displayfd", str(writer), "-screen", "0", f"{columns}x{rows}x24", "-nolisten", "tcp"],
        pass_fds=(writer,),
        stderr=subprocess.DEVNULL,
    )
    os.close(writer)
    try:
        with os.fdopen(reader) as told:
            display = ":" + told.readline().strip()
        monkeypatch.setenv("DISPLAY", display)
        monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
        yield display
    finally:
        process.kill()
        process.wait()
