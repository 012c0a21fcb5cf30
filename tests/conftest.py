"""Fixtures that every part shares."""

from __future__ import annotations

from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Real and rendered captures with known answers, kept beside the checkout and never in it."""
    folder = ROOT.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip(f"needs the captures with known answers in {folder.relative_to(ROOT.parent)} beside the checkout")
    return folder
