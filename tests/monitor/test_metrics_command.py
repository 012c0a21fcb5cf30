"""The page of metrics is what `METRICS` says today."""

from __future__ import annotations

from pathlib import Path

import pytest

from monitor.cli import run_tokens
from pipelines.change import METRICS

ROOT = Path(__file__).resolve().parents[2]


def test_the_page_is_current(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_tokens(["metrics"]) == 0
    page = capsys.readouterr().out
    assert page == (ROOT / "docs" / "metrics.md").read_text(encoding="utf-8"), (
        "microrelief metrics --out docs/metrics.md"
    )
    for metric in METRICS.values():
        for words in (f"`{metric.name}`", metric.title, metric.definition, metric.uncertainty):
            assert words in page
