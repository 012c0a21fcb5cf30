"""`make bench`: every benchmark in turn, each figure beside its peer or its floor."""

from __future__ import annotations

import importlib
from pathlib import Path

if __name__ == "__main__":
    for file in sorted(Path(__file__).parent.glob("bench_*.py")):
        importlib.import_module(f"tests.benchmarks.{file.stem}").main()
        print()
