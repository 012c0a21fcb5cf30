"""The command line: a table of commands, each loaded when it is called, and one place where errors end."""

from __future__ import annotations

import difflib
import inspect
import os
import sys
from collections.abc import Callable, Sequence
from importlib import import_module
from typing import Any

from cyclopts import App, CycloptsError
from cyclopts.exceptions import MissingArgumentError, UnusedCliTokensError

from configs import ConfigError, MicroreliefError

from . import __version__
from .system_libraries import missing_library

__all__ = ["COMMANDS", "example_of", "load_command", "main", "run_tokens"]

COMMANDS: dict[str, tuple[str, str]] = {
    "demo": ("demo:demo", "The whole job on a simulated rig, no questions asked."),
    "init": ("init:init", "Write a commented campaign to start from."),
    "doctor": ("doctor:doctor", "Say what is wrong with this machine or a campaign, and how to mend it."),
    "patterns": ("patterns:patterns", "Write the images to project."),
    "calibrate": ("calibrate:calibrate", "Calibrate a rig from captures of a board."),
    "diagnose": ("diagnose:diagnose", "Say what is wrong with a capture, and how to mend it."),
    "reconstruct": ("reconstruct:reconstruct", "Turn one capture into a height map."),
    "area": ("area:area", "Scan an area larger than one field of view, tile by tile, with a stage."),
    "mosaic": ("mosaic:mosaic", "Stitch the tiles of a scanning stage into one height map."),
    "merge": ("merge:merge", "Merge views of one object from several sides."),
    "compare": ("compare:compare", "Say what changed between two height maps, and how surely."),
    "repeatability": ("repeatability:repeatability", "Calibrate the level of detection on scans that did not change."),
    "roughness": ("roughness:roughness", "Measure a surface's roughness after ISO 25178-2."),
    "run": ("run:run", "Monitor on a schedule; survives restarts."),
    "scan": ("run:scan", "Take one scan now."),
    "video": ("video:video", "Record continuous 3D video."),
    "status": ("status:status", "Say how a campaign stands: last, next, missed, alarms."),
    "ack": ("ack:ack", "Acknowledge an alarm."),
    "annotate": ("annotate:annotate", "Keep a remark in a store, at a scan or a time."),
    "serve": ("serve:serve", "Show how campaigns stand on a page for browsers, and to Prometheus."),
    "health": ("health:health", "Say how a campaign's rig is: timings, light, how its lamp ages."),
    "service": ("service:service", "Print a unit file of systemd that runs a campaign."),
    "verify": ("verify:verify", "Read every chunk of a store and check every invariant."),
    "store": ("store:store", "Take care of a store: gc, expire, compact, stat, copy."),
    "process": ("process:process", "Work stored scans out again, from their frames where they are kept."),
    "rebaseline": ("rebaseline:rebaseline", "Begin a new epoch: compare with another scan from now on."),
    "ingest": ("ingest:ingest", "Take height maps and clouds of other scanners into a store."),
    "export": ("export:export", "Write a stored scan, its change or the series as a file for other programs."),
    "review": ("review:review", "Look through a store on the Rerun timeline."),
    "report": ("report:report", "Write a trend report."),
    "movie": ("movie:movie", "Film the surface and its change, for a talk."),
    "track": ("track:track", "Follow what moves on a surface through a store."),
    "cracks": ("cracks:cracks", "Follow every crack by name through a store: length, width, depth, tips."),
    "plates": ("plates:plates", "Follow every plate by name through a store: lift, angle, curvature, what breaks."),
    "resolution": ("resolution:resolution", "Measure contrast against line width, and depth of field, on a chart."),
    "optics": ("optics:optics", "Work out the geometry of a rig: angles, overlap, blur, diffraction."),
    "metrics": ("metrics:metrics", "Say what every metric is, and what its uncertainty is made of."),
    "schema": ("schema:schema", "Write the JSON schema of campaign files, for editors."),
}
"""Every command: the function in `monitor.commands` that it calls, imported only then, and what it does."""

ABOUT = "Watch a surface in 3D for seconds, months or years."
EPILOGUE = "`microrelief COMMAND --help` tells more, with an example. `--debug` shows the traceback of an error."


def main() -> None:
    """Entry point of the console script; leaves with the exit code of DESIGN section 5."""
    tokens = sys.argv[1:]
    debug = "--debug" in tokens
    try:
        code = run_tokens([word for word in tokens if word != "--debug"], debug=debug)
        sys.stdout.flush()
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)
        code = 130
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # the reader (head, less) has gone: be quiet
        code = 0
    sys.exit(code)


def run_tokens(tokens: Sequence[str], *, debug: bool = False) -> int:
    """Run one command line.

    Parameters
    ----------
    tokens : sequence of str
        The words after ``microrelief``.
    debug : bool
        Let errors pass, for their traceback.

    Returns
    -------
    int
        The exit code.
    """
    try:
        app = _app_for(tokens)
        result = app(list(tokens), exit_on_error=False, print_error=False)
    except (CycloptsError, ConfigError, MicroreliefError, ImportError) as error:
        if debug:
            raise
        message, code = _explain(error, tokens)
        print(message, file=sys.stderr)
        return code
    return result if isinstance(result, int) else 0


def _app_for(tokens: Sequence[str]) -> App:
    """Build the app that these words need: with one command loaded, or with all of them as a table."""
    name = tokens[0] if tokens else ""
    if name and not name.startswith("-") and name not in COMMANDS:
        near = difflib.get_close_matches(name, COMMANDS, n=1)
        hint = f", did you mean {near[0]!r}?" if near else "; `microrelief --help` lists them"
        raise UsageError(f"no command {name!r}{hint}")
    app = App(name="microrelief", help=ABOUT, help_epilogue=EPILOGUE, version=__version__, result_action="return_value")
    if name in COMMANDS:
        command = load_command(name)
        app.command(command, name=name, help_epilogue=example_of(command))
    else:
        for position, (each, (where, about)) in enumerate(COMMANDS.items()):
            app.command(f"{__package__}.commands.{where}", name=each, help=about, sort_key=position)
    return app


def load_command(name: str) -> Callable[..., Any]:
    """Import the function of a command."""
    module, _, function = COMMANDS[name][0].partition(":")
    command: Callable[..., Any] = getattr(import_module(f"{__package__}.commands.{module}"), function)
    return command


class UsageError(MicroreliefError):
    """The command line itself is wrong."""

    exit_code = 2


def example_of(command: Callable[..., Any]) -> str:
    """Take the example out of a command's docstring: cyclopts shows the other sections only."""
    lines = (inspect.getdoc(command) or "").splitlines()
    for index, line in enumerate(lines[:-1]):
        if line.strip() in ("Example", "Examples") and set(lines[index + 1].strip()) == {"-"}:
            body = inspect.cleandoc("\n".join(lines[index + 2 :])).replace("::\n", ":\n")
            return f"Example\n\n```text\n{body}\n```"
    return ""


def _explain(error: Exception, tokens: Sequence[str]) -> tuple[str, int]:
    """Give the line that a person reads, and the exit code."""
    if isinstance(error, ConfigError):
        return str(error), error.exit_code  # each line begins with FILE:LINE:COLUMN, which editors and terminals open
    if isinstance(error, MicroreliefError):
        return f"microrelief: {error}", error.exit_code
    if isinstance(error, ImportError):
        return f"microrelief: {missing_library(error)}", 1
    command = tokens[0] if tokens and tokens[0] in COMMANDS else ""
    if isinstance(error, UnusedCliTokensError):
        text = f"too many arguments: {' '.join(error.unused_tokens or ())}"
    elif isinstance(error, MissingArgumentError) and error.argument is not None and error.argument.token_count():
        text = _missing(error.argument.name, tokens)
    elif command:
        text = str(error)
    else:
        text = f"unknown option {tokens[0]}"
    return f"microrelief: {text.rstrip('.')}; see `microrelief {command + ' ' if command else ''}--help`", 2


def _missing(name: str, tokens: Sequence[str]) -> str:
    """Say which argument is missing: one named by its place, an option, or an option's value."""
    if name in tokens:
        given = tokens[tokens.index(name) + 1 :][:1]
        if given and given[0][:1] == "-" and given[0][1:2].isdigit():  # taken for an option
            return f"a value that begins with a minus sign is written {name}={given[0]}"
        return f"{name} needs a value"
    return f"{name} is missing" if tokens[1:] else f"{name.removeprefix('--').upper()} is missing"


if __name__ == "__main__":
    main()
