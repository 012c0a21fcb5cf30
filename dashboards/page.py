"""A report's sections as one HTML page that needs nothing else, by templates that a user may replace."""

from __future__ import annotations

import json
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

from configs import InputError

from .section import Figure, Section

if TYPE_CHECKING:
    from jinja2 import Environment

__all__ = ["TEMPLATES", "fill_templates", "page_style", "render_page", "shipped"]

TEMPLATES = ("report.html", "section.html", "report.css", "report.js", "report.typ")
"""What a folder of a user's own templates may hold; what it lacks is ours."""


def render_page(sections: Sequence[Section], *, site: str, kind: str, software: str, templates: Path | None) -> str:
    """Give the page as HTML.

    Parameters
    ----------
    sections : sequence of Section
    site, kind, software : str
        The title, what sort of report this is, and what made it.
    templates : Path or None
        Folder of the user's own templates.

    Raises
    ------
    InputError
        If one of them cannot be used.
    """
    from jinja2 import TemplateError
    from markupsafe import Markup

    plots, numbers = _numbers([figure for section in sections for figure in section.figures])
    try:
        return (
            _environment(templates)
            .get_template("report.html")
            .render(
                site=site,
                kind=kind,
                software=software,
                sections=sections,
                has_plots=bool(numbers),
                plots=Markup(json.dumps(plots, separators=(",", ":")).replace("<", "\\u003c")),  # noqa: S704 - no markup left
                plot_number=lambda figure: numbers[id(figure)],
                vendored=lambda name: Markup(shipped(f"vendored/{name}").strip()),  # noqa: S704 - files of this package
            )
        )
    except TemplateError as error:
        name, line = getattr(error, "filename", None), getattr(error, "lineno", None)
        where = f" {name or ''}{f':{line}' if line else ''}" if name else ""
        raise InputError(f"a template of {templates} cannot be used:{where} {error}") from None


def page_style() -> str:
    """Give the style of reports, which other pages share: colours of both schemes, charts, tables."""
    return shipped("templates/report.css")


def fill_templates(folder: Path) -> bool:
    """Copy our templates into a folder that is not there or empty, to start from; say whether that was done.

    Raises
    ------
    InputError
        If it is no folder, or cannot be written.
    """
    try:
        if folder.exists() and any(folder.iterdir()):
            return False
        folder.mkdir(parents=True, exist_ok=True)
        for name in TEMPLATES:
            (folder / name).write_text(shipped(f"templates/{name}"), encoding="utf-8")
    except OSError as error:
        raise InputError(f"--templates {folder}: {error.strerror}") from None
    return True


def _environment(templates: Path | None) -> Environment:
    """Look for a template in the user's folder first; ours stay within reach as ``shipped/NAME``."""
    from jinja2 import (
        BaseLoader,
        ChoiceLoader,
        Environment,
        FileSystemLoader,
        PackageLoader,
        PrefixLoader,
        StrictUndefined,
    )

    ours = PackageLoader("dashboards", "templates")
    loaders: list[BaseLoader] = [FileSystemLoader(templates)] if templates is not None else []
    return Environment(
        loader=ChoiceLoader([*loaders, ours, PrefixLoader({"shipped": ours})]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def _numbers(figures: Sequence[Figure]) -> tuple[dict[str, Any], dict[int, int]]:
    """Collect what the page's charts draw; times that several share are kept once."""
    times: list[list[float]] = []
    plots: list[dict[str, Any]] = []
    numbers: dict[int, int] = {}
    for figure in figures:
        if figure.plot is None:
            continue
        if figure.plot["times"] not in times:
            times.append(figure.plot["times"])
        rest = {name: value for name, value in figure.plot.items() if name != "times"}
        numbers[id(figure)] = len(plots)
        plots.append({"at": times.index(figure.plot["times"]), **rest})
    return {"times": times, "plots": plots}, numbers


def shipped(name: str) -> str:
    """Read a text file of this package."""
    return files("dashboards").joinpath(name).read_text(encoding="utf-8")
