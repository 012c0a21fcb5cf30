"""Verdict: what a reader in a hurry needs."""

from __future__ import annotations

from ..findings import Findings
from ..section import Section
from ..verdict import judge_findings

__all__ = ["verdict"]


def verdict(findings: Findings) -> Section:
    """Say green, amber, red or no data, and why."""
    found = judge_findings(findings)
    return Section("verdict", found.headline, text=found.reasons, tone=found.tone)
