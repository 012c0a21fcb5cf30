"""Objects in a notebook show what they are, and the example notebooks run as they stand."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dashboards import show
from pipelines import Frames, Measurement, PatternSet
from storage import open_store

from .drying import START, DryingStore, drying_store
from .filled_store import fill_store

FOLDER = Path(__file__).parents[2] / "docs" / "notebooks"
NOTEBOOKS = sorted(file.name for file in FOLDER.glob("*.ipynb"))


@pytest.fixture
def shell(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Any]:
    """A notebook's own interpreter, in an empty folder, without a kernel's process."""
    from IPython.core.interactiveshell import InteractiveShell

    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path / ".ipython"))
    made: Any = InteractiveShell()  # type: ignore[no-untyped-call]  # IPython has no types
    made.history_manager.enabled = False
    yield made
    made.reset(new_session=False)
    made.history_manager.end_session()


def cells(name: str) -> list[str]:
    notebook = json.loads((FOLDER / name).read_text(encoding="utf-8"))
    assert all(not cell.get("outputs") for cell in notebook["cells"]), "outputs are made, not kept"
    return ["".join(cell["source"]) for cell in notebook["cells"] if cell["cell_type"] == "code"]


def test_these_are_there() -> None:
    assert NOTEBOOKS == ["microbe-video.ipynb", "own-scanner.ipynb", "site-monitoring.ipynb"]


@pytest.mark.parametrize("name", NOTEBOOKS)
def test_an_example_runs(name: str, shell: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    if name == "site-monitoring.ipynb":
        fill_store(drying_store(8, 48), tmp_path / "demo-out" / "demo.icechunk")
    shown = []
    for cell in cells(name):
        ran = shell.run_cell(cell)
        assert ran.success, f"{name}: {cell}\n{ran.error_before_exec or ran.error_in_exec}"
        if ran.result is not None:
            shown.append(shell.display_formatter.format(ran.result)[0].get("text/html", ""))
    told = capsys.readouterr().out
    assert all(shown)
    if name == "microbe-video.ipynb":
        found = re.search(r"(\d+) of 5 organisms in the last scan, (\d+) µm", told)
        assert found is not None
        assert int(found[1]) == 5
        assert int(found[2]) < 40
    elif name == "own-scanner.ipynb":
        volume = re.search(r"Volume gained: ([\d.]+) ± ([\d.]+)", told)
        put = re.search(r"put there: ([\d.]+)", told)
        assert volume is not None
        assert put is not None
        assert abs(float(volume[1]) - float(put[1])) < 0.1 * float(put[1])
        assert "Comparison of two scans" in (tmp_path / "report" / "report.html").read_text(encoding="utf-8")
    else:
        assert "certain: True" in told
        assert (tmp_path / "change.gif").stat().st_size > 10_000


@pytest.mark.soak
@pytest.mark.parametrize("name", NOTEBOOKS)
def test_an_example_runs_in_a_kernel_of_its_own(name: str, tmp_path: Path) -> None:
    import nbclient
    import nbformat

    if name == "site-monitoring.ipynb":
        fill_store(drying_store(8, 48), tmp_path / "demo-out" / "demo.icechunk")
    notebook = nbformat.read(FOLDER / name, as_version=4)  # type: ignore[no-untyped-call]  # it has no types
    nbclient.NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(tmp_path)}}).execute()
    assert any("text/html" in out.get("data", {}) for cell in notebook.cells for out in cell.get("outputs", ()))


def test_objects_say_what_when_and_in_which_unit(drying: DryingStore, tmp_path: Path) -> None:
    stored = drying[-1]
    scan = show(stored.scan)
    for word in (
        "2026-05-05 18:00 UTC",
        "120 x 120 cells of 83.33 µm (10 x 10 mm)",
        "4 µm (median)",
        "<svg",
        "mm</text>",
    ):
        assert word in scan
    assert stored.change is not None
    assert "13 µm (median)" in show(stored.change)
    assert "crack opening: alarm" in show(stored)
    assert "120 x 120 cells" in show(stored.scan.grid)
    assert ">1.20 ± 0.10<" in show(Measurement(1.2, 0.1))
    patterns = PatternSet("gray", (16, 16), (4, 4))
    stack = np.zeros((len(patterns.roles), 4, 6), np.uint8)
    assert "of 6 x 4 px, 8 bit" in show(Frames(stack, START, patterns, 8.0))
    assert "gray, 16 x 16" in show(patterns)
    store = open_store(fill_store(drying_store(2, 16, site="<b>"), tmp_path / "s.icechunk"))
    assert "&lt;b&gt;" in show(store)
    store.close()
    with pytest.raises(TypeError, match="no picture of a int"):
        show(3)


def test_a_scan_without_a_single_measured_cell_shows_itself_too() -> None:
    blind = drying_store(1, 12)[0].scan
    nothing = np.full(blind.grid.shape, np.nan, np.float32)
    from dataclasses import replace

    assert "none" in show(replace(blind, height=nothing, sigma=nothing))
