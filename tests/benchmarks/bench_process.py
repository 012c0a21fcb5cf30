"""What it costs to work 500 small stored scans out again: here, on 2 workers, on a cluster of 2 from the command line.

``python -m tests.benchmarks.bench_process [SCANS]`` prints the table.
"""

from __future__ import annotations

import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

from tests.monitor.stored import fill
from tests.monitor.test_process import RULES, cluster, contents, run, same


def main(count: int = 500) -> None:
    """Print the table."""
    print(f"process: {count} scans of 40 x 52 cells from 30 frames of 96 x 72, each made again, compared and committed")
    with tempfile.TemporaryDirectory() as name, cluster(2) as address:
        path = Path(name) / "s"
        fill(path, count).close()
        first = None
        # each run is of other settings by name, so that none finds its work done
        for what, workers, scheduler in (
            ("in this process", 1, None),
            ("2 workers of this machine", 2, None),
            ("a cluster of 2 workers from the command line", 1, address),
        ):
            began = time.perf_counter()
            run(path, replace(RULES, settings=what), workers, scheduler)
            took = time.perf_counter() - began
            found = contents(path)
            first = found if first is None else first
            same(first, found)
            print(f"  {what:<46} {took:6.1f} s, {count / took:5.1f} scans/s, the same to the bit")


if __name__ == "__main__":
    main(*(int(word) for word in sys.argv[1:]))
