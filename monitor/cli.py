"""The command line: a table of commands, each loaded when it is called, and one place where errors end."""

from __future__ import annotations

import os
import sys
from typing import Annotated

from cyclopts import App, CycloptsError, Parameter

from configs import MicroreliefError

from . import __version__

__all__ = ["app", "main"]

COMMANDS: dict[str, str] = {
    "patterns": "monitor.commands.patterns:patterns",
    "calibrate": "monitor.commands.calibrate:calibrate",
    "reconstruct": "monitor.commands.reconstruct:reconstruct",
    "demo": "monitor.commands.demo:demo",
    "init": "monitor.commands.init:init",
    "doctor": "monitor.commands.doctor:doctor",
    "run": "monitor.commands.run:run",
    "scan": "monitor.commands.run:scan",
    "video": "monitor.commands.video:video",
    "status": "monitor.commands.status:status",
    "schema": "monitor.commands.schema:schema",
    "review": "monitor.commands.review:review",
    "report": "monitor.commands.report:report",
}
"""Every command and where it lives: ``module:function``, imported only when that command is called."""

app = App(
    name="microrelief",
    help="Watch a surface in 3D for seconds, months or years.",
    version=__version__,
    result_action="return_value",
)
for _name, _where in COMMANDS.items():
    app.command(_where, name=_name)


@app.meta.default
def _launch(
    *tokens: Annotated[str, Parameter(show=False, allow_leading_hyphen=True)], debug: bool = False
) -> int | None:
    """Run one command.

    Parameters
    ----------
    debug
        Show the traceback of an error.
    """
    try:
        result = app(tokens, exit_on_error=False, print_error=True)
    except MicroreliefError as error:
        if debug:
            raise
        print(f"microrelief: {error}", file=sys.stderr)
        return error.exit_code
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # the reader (head, less) has gone: be quiet
        return 0
    return result if isinstance(result, int) else 0


def main() -> None:
    """Entry point of the console script; leaves with the exit code of DESIGN section 5."""
    try:
        code = app.meta(exit_on_error=False, print_error=True, result_action="return_value")
    except CycloptsError:
        code = 2
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)
        code = 130
    sys.exit(code if isinstance(code, int) else 0)


if __name__ == "__main__":
    main()
