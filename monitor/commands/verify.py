"""The command `verify`."""

from __future__ import annotations

from storage import verify as verify_store

from ..forecast import format_bytes
from ..progress import progress

__all__ = ["verify"]


def verify(store: str) -> int:
    """Read every chunk of a store and check every invariant; change nothing.

    Checked are checksums, the order of times and numbers, units, packing, coarse means against cells, calibrations,
    older snapshots, files that nobody needs, the ledger, and that commits stay as small as they were. One line for each
    finding: what, where, what to do. Exit code 1: damaged.

    Parameters
    ----------
    store
        The store's folder or address.

    Examples
    --------
    microrelief verify soil.icechunk
    """
    with progress("verifying arrays") as show:
        verified = verify_store(store, show)
    for finding in verified.findings:
        print(finding)
    count = sum(finding.level == "damaged" for finding in verified.findings)
    state = f"{count} {'thing is' if count == 1 else 'things are'} damaged" if count else "ok"
    print(
        f"{store}: {state}: {verified.scans} scans, {verified.snapshots} snapshots, {verified.arrays} arrays, "
        f"{format_bytes(verified.cells_bytes)} read"
    )
    return 1 if verified.damaged else 0
