"""Seconds per scan of a review at 500x500, beside compressing the same cells; seconds of a report of 14 scans."""

from __future__ import annotations

import tempfile
import zlib
from pathlib import Path
from time import perf_counter

from dashboards import record_review, write_report
from tests.dashboards.drying import drying_store

SCANS, SIZE = 14, 500
REVIEW_LIMIT_S, REPORT_LIMIT_S = 0.35, 10.0


def main() -> None:
    """Print the table."""
    store = drying_store(SCANS, SIZE)
    with tempfile.TemporaryDirectory() as folder:
        record_review(drying_store(2, 20), Path(folder) / "imports.rrd")
        began = perf_counter()
        record_review(store, Path(folder) / "review.rrd")
        review = (perf_counter() - began) / SCANS
        size = (Path(folder) / "review.rrd").stat().st_size / SCANS / 1e6
        began = perf_counter()
        write_report(store, Path(folder) / "report")
        report = perf_counter() - began
    began = perf_counter()
    for stored in store.scans:
        zlib.compress(stored.scan.height.tobytes(), 4)
    floor = (perf_counter() - began) / SCANS
    print(f"dashboards, {SCANS} scans of {SIZE}x{SIZE}")
    print(f"  review, s per scan (at most {REVIEW_LIMIT_S:g})      {review:8.3f}   {size:.2f} MB a scan")
    print(f"  zlib of the heights alone, s per scan   {floor:8.3f}")
    print(f"  report, s (at most {REPORT_LIMIT_S:g})               {report:8.3f}")


if __name__ == "__main__":
    main()
