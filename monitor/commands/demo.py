"""The command `demo`."""

from __future__ import annotations

import shlex
import shutil
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from configs import InputError, StoreError
from storage import Store, open_store

from ..check import load_checked
from ..demo import JudgedScan, count_scans, judge_store, prepare, run_demo
from ..log import set_up_log
from ..progress import progress
from ..settled import Settled
from ..stopping import graceful_stop

__all__ = ["demo", "our_command"]


def demo(*, out: Path = Path("demo-out"), scans: int = 14) -> int:
    """Do the whole job on a simulated rig: three days of drying soil in about two minutes.

    Calibrates the rig on a simulated board, runs a campaign on an accelerated clock through the code of `run`, prints
    what it measured beside what the simulator knows to be true, and writes a store, a Rerun review and a report. Run
    again with the same folder it continues that campaign.

    Parameters
    ----------
    out
        Folder for everything; made where it is not there.
    scans
        Scans in all; a campaign that holds fewer is continued.

    Examples
    --------
    microrelief demo
    microrelief demo --out demo-out --scans 20
    """
    if scans < 2:
        raise InputError(f"--scans must be at least 2 (a baseline and one to compare), not {scans}")
    set_up_log()
    file = prepare(out)
    campaign = load_checked(file).campaign
    began = time.perf_counter()
    there = count_scans(campaign)
    with graceful_stop() as stop, progress("scans") as show:
        done = there

        def settled(each: Settled) -> None:
            nonlocal done
            done += each.number is not None
            show(done, scans)

        outcome = run_demo(file, scans, settled, lambda what: print(what, flush=True), stop)
    if stop.is_set():
        print(f"stopped with {done} of {scans} scans; the same command goes on from there")
        return 130
    store = open_store(campaign.store.path)
    try:
        if outcome is None:
            print(f"{campaign.store.path} holds {len(store)} scans already; --scans {len(store) + 1} or more goes on")
        elif there:
            print(f"continued from scan {there - 1}: {len(store)} scans in all")
        if len(store) < scans:
            raise StoreError(f"only {len(store)} of {scans} scans were taken; `microrelief status {file}` says why")
        _print_table(judge_store(store, file))
        review, page = _show(store, out)
    finally:
        store.close()
    from dashboards import open_command

    print(f"\nDone in {time.perf_counter() - began:.0f} s. What you have now:\n")
    us = our_command()
    for what, where, how in (
        ("store", campaign.store.path, f"{us} status {file}"),
        ("review", review, f"{us} review {campaign.store.path}    or: {open_command(review)}"),
        ("report", page, "open it in any browser; it needs no network"),
    ):
        print(f"  {what:<7} {where}\n          {how}")
    return 0


def our_command() -> str:
    """How a person who copies it starts microrelief: `make demo` leaves its environment without activating it."""
    beside = Path(sys.executable).parent / "microrelief"
    return "microrelief" if shutil.which("microrelief") or not beside.exists() else shlex.quote(str(beside))


def _show(store: Store, out: Path) -> tuple[Path, Path]:
    from dashboards import record_review, write_report

    review = out / "review.rrd"
    with progress("review") as show:
        record_review(store, review, progress=show)
    with progress("report") as show:
        page = write_report(store, out / "report", progress=show)
    return review, page


def _print_table(scans: Sequence[JudgedScan]) -> None:
    """Print measured, standard uncertainty, truth and error of each scan."""
    from rich import box
    from rich.console import Console
    from rich.table import Table

    units = {"net_volume": "mm3", "crack_opening": "mm", "edge_lift": "mm"}
    names = [each.metric for each in scans[0].judged]
    table = Table(box=box.SIMPLE, title="Measured (± standard uncertainty), and error against the simulator's truth")
    table.add_column("scan", justify="right")
    table.add_column("after", justify="right", no_wrap=True)
    for name in names:
        table.add_column(f"{name.replace('_', ' ')}, {units[name]}", justify="right", no_wrap=True)
        table.add_column("error", justify="right", no_wrap=True)
    for scan in scans:
        cells = []
        for each in scan.judged:
            digits = {"net_volume": 2, "edge_lift": 4}.get(each.metric, 3)
            cells += [f"{each.value:.{digits}f} ± {each.sigma:.{digits}f}", f"{each.error:+.{digits}f}"]
        table.add_row(str(scan.number), f"{scan.elapsed_h:g} h", *cells)
    console = Console(highlight=False)
    if console.width < 100:
        console = Console(highlight=False, width=100)
    console.print(table)
    print(
        "Truth of the net volume: the scene's closed form over the cells measured in both scans; of crack opening and\n"
        f"edge lift: over the whole region. The last scan covers {100 * scans[-1].covered:.0f} % of it. With the crack "
        f"floors that no\nray reaches the true net volume is {scans[-1].whole_volume_mm3:.2f} mm3."
    )
