"""Writes docs/accuracy.md: runs what measures accuracy, and keeps what each command printed, word for word.

``python -m tests.benchmarks.accuracy_page docs/accuracy.md`` (``make accuracy``)
"""

from __future__ import annotations

import os
import platform
import re
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
TESTS = "tests/pipelines"
TESTS_FAILED = 1
"""How pytest ends where it ran and a test failed."""


@dataclass(frozen=True)
class Proof:
    """What is measured, against which truth, and by which tests or module."""

    title: str
    truth: str
    run: str

    @property
    def is_test(self) -> bool:
        return self.run.startswith("tests/")

    @property
    def command(self) -> str:
        return f"pytest -n0 -s {self.run}" if self.is_test else f"python -m {self.run}"


PROOFS = (
    Proof(
        "Height maps of captures with known answers",
        "Truth: an independent path tracer's exact depth (`rendered`), and a real board of known size at 3.4 m "
        "(`kamino410`). Each calibrated from its own board poses.",
        f"{TESTS}/reconstruction/test_known_captures.py",
    ),
    Proof(
        "Change between two rendered captures",
        "Truth: the renderer's two surfaces: the crack's opening by row, two deposits, the slope of the curled edge.",
        f"{TESTS}/test_rendered_change.py",
    ),
    Proof(
        "The paper's rig, simulated at 2560x1440",
        "Truth: a plane and a step in closed form, seen through the simulated optics.",
        "tests.benchmarks.bench_accuracy",
    ),
    Proof(
        "Sigma, on the simulated rig",
        "Error over sigma should be 1: against the surface's closed form, and against repeated scans.",
        "tests/monitor/rigs/test_sigma.py",
    ),
    Proof(
        "Stripes of equal width, and phase shifting",
        "Truth: the projector's column at each pixel, through simulated blur and noise.",
        f"{TESTS}/reconstruction/test_stripes.py {TESTS}/reconstruction/test_phase.py",
    ),
    Proof(
        "M3C2 and registration against other programs",
        "py4dgeo's distances on a measured surface; xdem's offset on terrain.",
        f"{TESTS}/change/test_m3c2.py {TESTS}/change/test_terrain.py {TESTS}/change/test_registration_trust.py",
    ),
    Proof(
        "Volume",
        "Sigma of a volume against the scatter of 500 simulated ones, and how often the interval holds the truth.",
        f"{TESTS}/change/test_volume.py",
    ),
    Proof(
        "Cracks on surfaces that nothing was tuned to",
        "Truth: masks, lengths, widths and volumes of surfaces in closed form, seeds used for nothing else.",
        f"{TESTS}/change/test_unseen_cracks.py",
    ),
    Proof("Plates", "Truth: warps in closed form.", f"{TESTS}/change/test_plates.py"),
    Proof(
        "Twenty organisms through a minute of video",
        "Truth: the scene's own places, volumes and names.",
        f"{TESTS}/change/test_tracking.py",
    ),
    Proof(
        "Control charts",
        "False alarms and delays, by simulation.",
        f"{TESTS}/trends/test_control.py",
    ),
)
"""Everything on the page, in its order."""


def main(arguments: Sequence[str] = tuple(sys.argv[1:])) -> int:
    """Run every proof and write the page; where a bar is not held, the page says so."""
    page = Path(arguments[0])
    parts = [
        "# How exact it is",
        "Each block is what the command above it printed, word for word; the page is written by `make accuracy`. The"
        " captures with known answers are not part of this repository: the tests look for them in `../shared/data`.",
        f"Written on {platform.system()}, {os.cpu_count()} cores, Python {platform.python_version()}. What is not good"
        " enough yet: [Limits](limits.md). How sigma is found: [Uncertainty](uncertainty.md).",
    ]
    for proof in PROOFS:
        print(f"{proof.title}: {proof.command}", flush=True)
        told = printed(proof)
        parts += [f"## {proof.title}", proof.truth, f"    {proof.command}", f"```text\n{told}\n```"]
    page.write_text("\n\n".join(parts) + "\n")
    print(f"wrote {page}")
    return 0


def printed(proof: Proof) -> str:
    """Run one proof and give the lines that it printed, less those of pytest."""
    words = proof.run.split()
    pytest = [sys.executable, "-m", "pytest", "-q", "-n0", "-s", "--no-header", "--color=no"]
    run = [*pytest, *words] if proof.is_test else [sys.executable, "-m", *words]
    done = subprocess.run(run, cwd=ROOT, capture_output=True, text=True)
    if done.returncode not in (0, TESTS_FAILED):
        sys.exit(f"{proof.command} did not run:\n{done.stdout[-3000:]}{done.stderr[-3000:]}")
    figures, _, failures = done.stdout.partition("= FAILURES =")
    lines = [re.sub(r"^[.FsxX]*\.(?=\S)", "", line.rstrip("= ")) for line in figures.splitlines()]
    missed = re.findall(r"^(?:FAILED .*|E +assert .*)", failures, flags=re.M)
    shown = [line for line in lines if line and not re.fullmatch(r"[.FsxX]+( +\[ *\d+%\])?", line)]
    return "\n".join([*shown, *(f"BAR NOT HELD: {line.removeprefix('E').strip()}" for line in missed)])


if __name__ == "__main__":
    sys.exit(main())
