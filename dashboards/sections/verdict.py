"""Verdict: what a reader in a hurry needs."""

from __future__ import annotations

from ..findings import Findings
from ..plain_words import in_plain_words
from ..section import Section
from ..verdict import judge_findings

__all__ = ["verdict"]


def verdict(findings: Findings) -> Section:
    """Say green, amber, red or no data, and why; then what happened to the surface."""
    found = judge_findings(findings)
    return Section("verdict", found.headline, (*found.reasons, *in_plain_words(findings)), tone=found.tone)
