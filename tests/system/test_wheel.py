"""The wheel: it carries everything beside its Python, and works where no checkout is near."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import sysconfig
import zipfile
from pathlib import Path

import pytest

from tests.dashboards.drying import drying_store
from tests.dashboards.filled_store import fill_store

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("configs", "pipelines", "storage", "dashboards", "monitor")
PIP = (sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet")


def called(*command: str | Path, folder: Path, code: int = 0) -> str:
    """Run a program in a folder, away from the checkout, and give what it said."""
    clean = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "DISPLAY"))}
    ended = subprocess.run([str(word) for word in command], cwd=folder, env=clean, capture_output=True, text=True)
    assert ended.returncode == code, ended.stderr
    return ended.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    called(*PIP, "wheel", "--no-deps", "--no-build-isolation", "--wheel-dir", folder, ROOT, folder=folder)
    (made,) = folder.glob("microrelief-*.whl")
    return made


def test_it_carries_every_file_of_its_packages(wheel: Path) -> None:
    listed = subprocess.run(["git", "ls-files", *PACKAGES], cwd=ROOT, capture_output=True, text=True, check=True)
    carried = set(zipfile.ZipFile(wheel).namelist())
    assert set(listed.stdout.split()) <= carried
    tops = {name.partition("/")[0] for name in carried}
    assert tops == {*PACKAGES, wheel.name.partition("-py3")[0] + ".dist-info"}


@pytest.mark.soak
def test_it_works_where_no_checkout_is_near(wheel: Path, tmp_path: Path) -> None:
    """All kernels are compiled anew there, which takes a minute."""
    called(sys.executable, "-m", "venv", "--without-pip", tmp_path / "env", folder=tmp_path)
    programs = tmp_path / "env" / "bin"
    called(*PIP, "--python", programs / "python", "install", "--no-deps", wheel, folder=tmp_path)
    (site,) = (tmp_path / "env").glob("lib/python3*/site-packages")
    # what microrelief needs comes from here, but not microrelief: a .pth file's folders have none of their own read
    (site / "needs.pth").write_text(sysconfig.get_paths()["purelib"] + "\n")
    run = programs / "microrelief"
    where = "import configs, dashboards, monitor; print(configs.__file__, dashboards.__file__, monitor.__file__)"
    assert all(name.startswith(str(site)) for name in called(programs / "python", "-c", where, folder=tmp_path).split())

    assert "microrelief report demo/demo.icechunk" in called(run, "report", "--help", folder=tmp_path)
    called(run, "init", "my-site", folder=tmp_path)
    for campaign in (tmp_path / "my-site/campaign.yaml", *sorted(site.glob("configs/*.yaml"))):
        assert called(run, "run", campaign, "--dry-run", folder=tmp_path)
    unit = called(run, "service", "my-site/campaign.yaml", folder=tmp_path)
    assert f"ExecStart={run} run" in unit
    called(run, "schema", "--out", "schema.json", folder=tmp_path)
    assert "schedule" in json.loads((tmp_path / "schema.json").read_text())["properties"]

    fill_store(drying_store(3, 40, alarm=False), tmp_path / "plot.icechunk")
    called(run, "report", "plot.icechunk", "--out", "report", "--pdf", folder=tmp_path)
    assert "uPlot" in (tmp_path / "report/report.html").read_text()
    assert (tmp_path / "report/report.pdf").read_bytes().startswith(b"%PDF")
    called(run, "review", "plot.icechunk", "--save", "plot.rrd", folder=tmp_path)
    assert (tmp_path / "plot.rrd").stat().st_size > 10_000
