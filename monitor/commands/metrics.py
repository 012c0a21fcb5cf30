"""The command `metrics`."""

from __future__ import annotations

from pathlib import Path

from configs import InputError
from pipelines import ENVIRONMENT, unit_text
from pipelines.change import METRICS

__all__ = ["metrics", "metrics_page"]

HEAD = """# Metrics

Every number that microrelief follows through time. Each has a value and a standard uncertainty (one standard
deviation); NaN means not measured. How they are computed: [change.md](change.md). This page is written by
`microrelief metrics --out docs/metrics.md`.
"""


def metrics_page() -> str:
    """Give the page of all metrics: name, unit, definition and what its uncertainty is made of."""
    parts = [HEAD]
    for metric in METRICS.values():
        unit = unit_text(metric.unit) or "a share, 0 to 1"
        parts.append(
            f'## {metric.title}\n\n<a id="{metric.name}"></a>`{metric.name}`, {unit}\n\n{metric.definition}\n\n'
            f"Standard uncertainty: {metric.uncertainty or 'as `measure` gives it.'}\n"
        )
    read = ", ".join(f"`{name}` ({unit_text(unit)})" for name, unit in ENVIRONMENT.items())
    parts.append(
        "## Environment\n\nBeside them a store may hold what a campaign's `environment` read at each scan: "
        f"{read},\nwith the standard uncertainty of the sensor as the campaign states it.\n"
    )
    return "\n".join(parts)


def metrics(*, out: Path | None = None) -> None:
    """Write the page of all metrics: what each is, in which unit, and what its uncertainty is made of.

    Parameters
    ----------
    out
        Markdown file to write; without it, standard output.

    Examples
    --------
    microrelief metrics
    microrelief metrics --out docs/metrics.md
    """
    if out is None:
        print(metrics_page(), end="")
        return
    try:
        out.write_text(metrics_page(), encoding="utf-8")
    except OSError as error:
        raise InputError(f"{out}: cannot be written: {error.strerror}") from None
    print(f"wrote {out}")
