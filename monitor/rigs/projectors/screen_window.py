"""The process that holds a projector's window: it shows what it is told to, until its line closes.

Run by its path and not as a module of our package, so that it starts in a moment: it needs numpy and pygame alone.

Its line is standard input: JSON, a line each, ``{"verb": "load", "shape": [frame, row, column]}`` (the bytes of the
images follow) or ``{"verb": "show", "frame": k}``. It answers each, and its own opening, by a line on standard output:
``{"is": "ok"}``, ``{"is": "input", "text": why}`` for what can never work, ``{"is": "gone", "text": why}`` else.
"""

from __future__ import annotations

import json
import os
import queue
import sys
import threading
from typing import IO, Any

import numpy as np
import numpy.typing as npt

DESKTOP_ROUND_S = 0.05
"""How often the desktop's messages are answered while nothing is asked."""


class _Refused(Exception):  # noqa: N818 - an answer to the rig, not a fault
    """What was asked can never work."""


def main(head: int) -> None:
    """Open a full-screen window on a head and serve the line until it closes."""
    os.environ["PYGAME_HIDE_SUPPORT_PROMPT"] = "1"
    os.environ.setdefault("SDL_VIDEO_MINIMIZE_ON_FOCUS_LOSS", "0")  # a click elsewhere must not hide the patterns
    try:
        import pygame
    except ImportError as error:
        _answer("input", f"a screen as projector needs `pip install 'microrelief[screen]'` ({error})")
        return
    try:
        window = _open_window(pygame, head)
    except pygame.error as error:
        _answer("gone", f"no window can be opened on the projector's screen ({error}): is a display connected?")
        return
    except _Refused as refused:
        _answer("input", str(refused))
        return
    _answer("ok")
    _serve(pygame, window, _listen(sys.stdin.buffer))
    pygame.quit()


def _open_window(pygame: Any, head: int) -> Any:
    pygame.display.init()
    sizes = pygame.display.get_desktop_sizes()
    if head >= len(sizes):
        raise _Refused(f"projector option head: there is no screen {head}; this computer has {len(sizes)}")
    window = pygame.display.set_mode(sizes[head], pygame.FULLSCREEN, display=head)
    pygame.display.set_caption("microrelief patterns")
    pygame.mouse.set_visible(False)
    window.fill((0, 0, 0))
    pygame.display.flip()
    return window


Ask = int | npt.NDArray[np.uint8] | None
"""A frame to show, images to load, or the end of the line."""


def _listen(line: IO[bytes]) -> queue.Queue[Ask]:
    """Read the line in a thread of its own: the window's thread must go on answering the desktop."""
    asked: queue.Queue[Ask] = queue.Queue()

    def read() -> None:
        while text := line.readline():
            ask = json.loads(text)
            if ask["verb"] == "load":
                shape = tuple(ask["shape"])
                images = np.frombuffer(line.read(int(np.prod(shape))), np.uint8)
                if images.size < np.prod(shape):  # the rig ended in the middle of its word
                    break
                asked.put(images.reshape(shape))
            else:
                asked.put(int(ask["frame"]))
        asked.put(None)

    threading.Thread(target=read, daemon=True).start()
    return asked


def _serve(pygame: Any, window: Any, asked: queue.Queue[Ask]) -> None:
    surfaces: list[Any] = []
    while True:
        pygame.event.pump()
        try:
            ask = asked.get(timeout=DESKTOP_ROUND_S)
        except queue.Empty:
            continue
        if ask is None:
            return
        if isinstance(ask, int):
            window.blit(surfaces[ask], (0, 0))
            pygame.display.flip()
        else:
            size = (ask.shape[2], ask.shape[1])
            if size != window.get_size():
                width, height = window.get_size()
                _answer(
                    "input",
                    f"the patterns have {size[0]}x{size[1]} pixels and the projector's screen {width}x{height}: "
                    "set `patterns.size` or the screen to the projector's own",
                )
                continue
            surfaces = [_surface(pygame, image) for image in ask]
        _answer("ok")


def _surface(pygame: Any, image: npt.NDArray[np.uint8]) -> Any:
    """An image of shape (row, column), grey, as a surface of the window's own format."""
    rows, columns = image.shape
    colour = np.repeat(image[:, :, None], 3, axis=2)
    return pygame.image.frombuffer(colour.tobytes(), (columns, rows), "RGB").convert()


def _answer(kind: str, text: str = "") -> None:
    print(json.dumps({"is": kind, "text": text}), flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]))
