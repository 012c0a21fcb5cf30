"""The Rerun viewer as a program: a window on this screen, or a page served to this machine alone."""

from __future__ import annotations

import os
import shlex
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from urllib.parse import quote, unquote

from configs import InputError, MicroreliefError

__all__ = [
    "LOCAL",
    "NO_SCREEN",
    "behind_proxy",
    "check_ports",
    "end",
    "free_port",
    "has_screen",
    "memory_limits",
    "open_command",
    "open_viewer",
    "serve_web",
    "start",
    "viewer_program",
    "wait_until_listening",
]

LOCAL = "127.0.0.1"
NO_SCREEN = (
    "no screen here to open a window on: add --web to open the review in a browser, "
    "or --save FILE.rrd to look at it on another machine"
)
FETCHED, SENT, FILE = "500MB", "300MB", "700MB"
"""What a viewer may hold of a recording before it lets go of what is far from the cursor, or oldest: of one that it can
fetch again from a catalog (with less it never has all that it shows, and fetches without end), of one that is sent to
it and goes on, and of a file. Its own needs come on top, several times that."""
LATE = "100MB"
"""What a viewer keeps, beside that, of what was sent to it, for other viewers that come later: there are none."""

_START_S = 20.0


def viewer_program() -> Path:
    """Find the viewer that came with rerun-sdk.

    The ``rerun`` script is a wrapper: ending it leaves the viewer running, so we start the program itself.

    Raises
    ------
    MicroreliefError
        If it is not installed.
    """
    import rerun_cli  # type: ignore[import-untyped]  # ships no types

    folder = Path(next(iter(rerun_cli.__path__)))
    names = {"darwin": ("Rerun.app/Contents/MacOS/Rerun", "rerun"), "win32": ("rerun.exe",)}.get(
        sys.platform, ("rerun",)
    )
    for name in names:
        if (folder / name).is_file():
            return folder / name
    raise MicroreliefError(f"the Rerun viewer is not in {folder}: install it again with pip install rerun-sdk")


def open_command(rrd: Path) -> str:
    """Give the shell command that opens a recording on this machine."""
    found = shutil.which("rerun")
    beside = Path(sys.executable).parent / "rerun"  # an environment that is not activated
    program = "rerun" if found or not beside.exists() else shlex.quote(str(beside))
    return f"{program} {shlex.quote(str(rrd))}"


def has_screen() -> bool:
    """Whether a window can be opened here."""
    if sys.platform in ("darwin", "win32"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def memory_limits(source: str | Path) -> list[str]:
    """Give the viewer's options for what it may hold of a file, of an address, or (empty) of what is sent to it."""
    limit = SENT if not source else FETCHED if "://" in str(source) else FILE
    return ["--memory-limit", limit, "--server-memory-limit", LATE]


def open_viewer(
    source: str | Path,
    port: int | None = None,
    *,
    along: Callable[[str], AbstractContextManager[None]] | None = None,
) -> None:
    """Show a recording in a window and return when that is closed.

    Parameters
    ----------
    source : str or Path
        A file, or an address as `serve_shards` gives it; empty for a viewer that waits for what is sent to it.
    port : int, optional
        Where the viewer itself listens, on this machine alone; a free one without it.
    along : callable, optional
        Gives, for the address at which the viewer takes what is sent to it, a context that lasts while the viewer does.

    Raises
    ------
    MicroreliefError
        If there is no screen, the port is taken, or the viewer fails.
    """
    if not has_screen():
        raise MicroreliefError(NO_SCREEN)
    if port is None:
        port = free_port()
    else:
        _check_free(port)
    command = [str(viewer_program()), "--bind", LOCAL, "--port", str(port), *memory_limits(source)]
    command += ["--hide-welcome-screen", *([str(source)] if source else ["--expect-data-soon"])]
    viewer = subprocess.Popen(command, env=_quiet(), stderr=subprocess.PIPE, text=True)
    try:
        if along is None:
            said = viewer.communicate()[1]
        else:
            wait_until_listening(viewer, port)
            with along(f"rerun+http://{LOCAL}:{port}/proxy"):
                said = viewer.communicate()[1]
    finally:
        end(viewer)
    if viewer.returncode not in (0, 130, -2):
        raise MicroreliefError(
            f"the Rerun viewer ended with code {viewer.returncode} ({_last_line(said)}): "
            "add --web to open the review in a browser instead"
        )


@contextmanager
def serve_web(source: str | Path, port: int = 9090) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """Serve a recording to browsers on this machine, on 127.0.0.1 alone.

    Parameters
    ----------
    source : str or Path
        A file, or the address of a catalog that is served already; empty for a recording that will be sent to
        ``port + 1``.
    port : int
        Of the page; the data of a file come through the next one, ``port + 1``.

    Yields
    ------
    (str, Popen)
        The link to open, and the server, which ends with the context.

    Raises
    ------
    InputError
        If there is no such port.
    MicroreliefError
        If a port is taken or the server fails.
    """
    address = str(source)
    served = "://" in address
    check_ports(port, 1 if served else 2)
    command = [str(viewer_program()), "--serve-web", "--bind", LOCAL, "--web-viewer-port", str(port)]
    if not served:
        command += ["--port", str(port + 1), "--server-memory-limit", "50%" if address else SENT]
    server = start([*command, *([address] if address else [])])
    try:
        wait_until_listening(server, port)
        if not served:
            wait_until_listening(server, port + 1)
            address = f"rerun+http://{LOCAL}:{port + 1}/proxy"
        # dark, as its colours are chosen for: a browser's own setting would put pale lines on white
        yield f"http://{LOCAL}:{port}/?url={quote(address, safe='')}&theme=dark", server
    finally:
        end(server)


def behind_proxy(link: str, page: str, data: str) -> str:
    """Give the link of `serve_web` as it is behind a reverse proxy.

    Parameters
    ----------
    link : str
    page, data : str
        Where the proxy shows the page, and where the data: ``https://review.example.org``.
    """
    source, _, looks = link.partition("?url=")[2].partition("&")
    place = unquote(source).partition("://")[2].partition("/")[2]
    return f"{page}/?url={quote(f'rerun+{data}/{place}', safe='')}&{looks}"


def start(command: list[str]) -> subprocess.Popen[str]:
    """Start a server of Rerun's that says nothing."""
    return subprocess.Popen(command, env=_quiet(), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, text=True)


def free_port() -> int:
    """Find a port of this machine on which nothing listens now."""
    with socket.socket() as probe:
        probe.bind((LOCAL, 0))
        port: int = probe.getsockname()[1]
        return port


def end(program: subprocess.Popen[str]) -> None:
    """End a program that still runs: politely, then not."""
    if program.poll() is not None:
        return
    program.terminate()
    try:
        program.wait(timeout=5)
    except subprocess.TimeoutExpired:
        program.kill()
        program.wait()


def check_ports(port: int, count: int = 2) -> None:
    """Refuse a port for a page, or the next one for its data, that is taken or does not exist."""
    for number in range(port, port + count):
        _check_free(number)


def _check_free(port: int) -> None:
    if not 1 <= port <= 65535:
        raise InputError(f"port {port} does not exist: choose one from 1024 to 65534")
    with socket.socket() as probe:
        if sys.platform != "win32":  # there this option would let two programs share a port
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((LOCAL, port))
        except OSError as error:
            raise MicroreliefError(
                f"port {port} cannot be used ({error.strerror}): choose another with --port"
            ) from None


def wait_until_listening(server: subprocess.Popen[str], port: int) -> None:
    """Wait for a server of ours; raise MicroreliefError where it does not come up."""
    deadline = time.monotonic() + _START_S
    while time.monotonic() < deadline:
        if server.poll() is not None:
            break
        with socket.socket() as probe:
            probe.settimeout(0.5)
            if probe.connect_ex((LOCAL, port)) == 0:
                return
        time.sleep(0.05)
    raise MicroreliefError(
        f"the review server did not start on port {port}: choose another with --port, or --save FILE.rrd"
    )


def _quiet() -> dict[str, str]:
    """The viewer's own start-up lines say nothing to the user of a review."""
    return {"RUST_LOG": "error", **os.environ}


def _last_line(text: str) -> str:
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return lines[-1] if lines else "no message"
