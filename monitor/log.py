"""The log: structured lines under the name ``microrelief``, to standard error and, where asked, as JSON to a file."""

from __future__ import annotations

import logging
import sys
from collections.abc import Sequence
from logging.handlers import RotatingFileHandler
from pathlib import Path
from typing import Any, Literal

import structlog

from configs import InputError

__all__ = ["LogFormat", "set_up_log"]

LogFormat = Literal["text", "json"]

FILE_BYTES = 5_000_000
FILES_KEPT = 5

_BEFORE: Sequence[Any] = (
    structlog.stdlib.add_logger_name,
    structlog.stdlib.add_log_level,
    structlog.processors.TimeStamper(fmt="iso", utc=True),
)


def set_up_log(*, debug: bool = False, form: LogFormat = "text", file: Path | None = None) -> None:
    """Send what ``microrelief.*`` loggers say to standard error: readable on a terminal, logfmt elsewhere.

    Parameters
    ----------
    debug : bool
        Say more than warnings.
    form : {"text", "json"}
        "json": a JSON object a line, on standard error too.
    file : Path, optional
        Write JSON lines there as well, everything from notices on; begun anew at 5 MB, the last five are kept.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    if form == "json":
        renderer: Any = structlog.processors.JSONRenderer()
    elif sys.stderr.isatty():
        renderer = structlog.dev.ConsoleRenderer()
    else:
        renderer = structlog.processors.LogfmtRenderer(key_order=("timestamp", "level", "logger", "event"))
    to_stderr = logging.StreamHandler(sys.stderr)
    to_stderr.setFormatter(_formatter(renderer))
    to_stderr.setLevel(logging.DEBUG if debug else logging.WARNING)
    handlers: list[logging.Handler] = [to_stderr]
    if file is not None:
        try:
            file.parent.mkdir(parents=True, exist_ok=True)
            to_file = RotatingFileHandler(file, maxBytes=FILE_BYTES, backupCount=FILES_KEPT, encoding="utf-8")
        except OSError as error:
            raise InputError(f"--log-file {file}: cannot be written: {error.strerror}") from None
        to_file.setFormatter(_formatter(structlog.processors.JSONRenderer()))
        handlers.append(to_file)
    logger = logging.getLogger("microrelief")
    for before in logger.handlers:
        before.close()
    logger.handlers[:] = handlers
    logger.propagate = False
    logger.setLevel(logging.DEBUG if debug else logging.INFO if file is not None else logging.WARNING)
    structlog.configure(
        processors=[structlog.stdlib.filter_by_level, *_BEFORE, structlog.stdlib.ProcessorFormatter.wrap_for_formatter],
        logger_factory=structlog.stdlib.LoggerFactory(),
        wrapper_class=structlog.stdlib.BoundLogger,
        cache_logger_on_first_use=False,
    )


def _formatter(renderer: Any) -> logging.Formatter:
    take_out = structlog.stdlib.ProcessorFormatter.remove_processors_meta
    return structlog.stdlib.ProcessorFormatter(foreign_pre_chain=_BEFORE, processors=[take_out, renderer])
