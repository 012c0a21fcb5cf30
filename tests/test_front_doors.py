"""Packages are entered through their front doors, and files keep to one idea."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("configs", "pipelines", "storage", "dashboards", "monitor")
DOORS = {
    "configs",
    "pipelines",
    "pipelines.reconstruction",
    "pipelines.change",
    "pipelines.trends",
    "pipelines.scenes",
    "storage",
    "dashboards",
}
SOURCES = sorted(file for package in PACKAGES for file in (ROOT / package).rglob("*.py"))


def entered(file: Path) -> list[str]:
    """Modules of other packages of ours that a file imports by absolute name."""
    found = []
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            found.append(node.module)
        elif isinstance(node, ast.Import):
            found.extend(alias.name for alias in node.names)
    return [name for name in found if name.split(".")[0] in PACKAGES]


@pytest.mark.parametrize("file", SOURCES, ids=lambda file: str(file.relative_to(ROOT)))
def test_other_packages_are_entered_by_their_front_door(file: Path) -> None:
    home = file.relative_to(ROOT).parts[0]
    strange = [name for name in entered(file) if name.split(".")[0] != home and name not in DOORS]
    assert not strange, f"import from a front door, not from {strange}"
    own = [name for name in entered(file) if name.split(".")[0] == home]
    assert not own, f"inside a package imports are relative: {own}"


@pytest.mark.parametrize("file", SOURCES, ids=lambda file: str(file.relative_to(ROOT)))
def test_a_file_is_one_idea_told_in_its_first_line(file: Path) -> None:
    text = file.read_text()
    assert text.startswith('"""'), "the first line says what the file is for"
    assert len(text.splitlines()) <= 400


def test_generic_top_level_names_resolve_to_us(tmp_path: Path) -> None:
    code = "import " + ", ".join(PACKAGES) + "; print(*(m.__file__ for m in (" + ", ".join(PACKAGES) + ")), sep='\\n')"
    told = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert [Path(line).parent for line in told.stdout.split()] == [ROOT / package for package in PACKAGES]


def test_nothing_committed_names_this_machine() -> None:
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True)
    if listed.returncode:
        pytest.skip("not a git checkout")
    # written in halves so that this file does not find itself
    forbidden = ("/wo" + "rk/", "/ro" + "ot/", "py" + "pi.org", "registry." + "npmjs", "deb." + "debian")
    for name in listed.stdout.splitlines():
        file = ROOT / name
        if file.suffix in {".png", ".ico"} or not file.is_file():
            continue
        text = file.read_text(errors="replace")
        assert not [word for word in forbidden if word in text], name
