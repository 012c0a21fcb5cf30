"""The documentation: it builds without a warning, no link is dead, and the program takes each command and key in it."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest
from cyclopts import App
from ruamel.yaml import YAML

from monitor.check import campaign_schema
from monitor.cli import COMMANDS, load_command

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md"), *(ROOT / "docs" / "decisions").glob("*.md")])
LINK = re.compile(r"\]\(([^)\s]+)\)")


def block_lines(page: Path) -> Iterator[tuple[str, str]]:
    """Give the language (empty for indented blocks) and text of each block of code."""
    text = page.read_text()
    for language, block in re.findall(r"^```(\S*)\n(.*?)^```", text, flags=re.S | re.M):
        yield language, block
    plain = re.sub(r"^```.*?^```", "", text, flags=re.S | re.M)
    for block in re.findall(r"(?:^    .*\n|^[ \t]*\n(?=    ))+", plain, flags=re.M):
        yield "", re.sub(r"^    ", "", block, flags=re.M)


def commands(page: Path) -> Iterator[str]:
    for _, block in block_lines(page):
        for line in block.replace("\\\n", " ").splitlines():
            if line.startswith("microrelief "):
                yield line


COMMAND_LINES = sorted({(page.name, line) for page in PAGES for line in commands(page)})


def test_the_site_builds_without_a_warning(tmp_path: Path) -> None:
    build = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-d", str(tmp_path / "read")]
    built = subprocess.run([*build, "docs", str(tmp_path / "site")], cwd=ROOT, capture_output=True, text=True)
    assert built.returncode == 0, built.stderr
    assert (tmp_path / "site" / "reference" / "commands.html").is_file()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_to_files_lead_somewhere(page: Path) -> None:
    for target in LINK.findall(page.read_text()):
        if re.match(r"[a-z]+:", target) or target.startswith("#"):
            continue
        file = page.parent / target.split("#")[0]
        written = (ROOT / "docs" / "reference") in file.parents  # by the build
        assert written or file.exists(), f"{page.name}: {target} is not there"


@pytest.mark.parametrize(("page", "line"), COMMAND_LINES, ids=lambda part: str(part)[:60])
def test_the_program_takes_every_command_that_is_shown(page: str, line: str) -> None:
    words = shlex.split(line, comments=True)[1:]
    words = words[: next((at for at, word in enumerate(words) if word in (">", "|", "&&", "...")), len(words))]
    if words[0] == "--help" or words[0].isupper():
        return
    assert words[0] in COMMANDS, f"{page}: no such command"
    app = App(name="microrelief")
    app.command(load_command(words[0]), name=words[0])
    app.parse_args([word for word in words if word != "--debug"], exit_on_error=False, print_error=False)


def campaign_parts() -> Iterator[tuple[str, Mapping[str, Any]]]:
    tops = set(campaign_schema()["properties"])
    for page in PAGES:
        for language, block in block_lines(page):
            first = re.match(r"([a-z_]+):(\s|$)", block.lstrip("\n"))
            if language in ("", "yaml") and first and first[1] in tops:
                yield page.name, YAML(typ="safe").load(block)


@pytest.mark.parametrize(("page", "part"), list(campaign_parts()), ids=lambda part: str(part)[:40])
def test_the_program_knows_every_campaign_key_that_is_shown(page: str, part: Mapping[str, Any]) -> None:
    schema = campaign_schema()
    for where, key, known in unknown_keys(part, schema, schema["$defs"]):
        pytest.fail(f"{page}: {where}{key} is no key; there are {', '.join(known)}")


def unknown_keys(
    value: Any, schema: Mapping[str, Any], parts: Mapping[str, Any], where: str = ""
) -> Iterator[tuple[str, str, list[str]]]:
    for choice in [schema, *schema.get("anyOf", ())]:
        if "$ref" in choice:
            yield from unknown_keys(value, parts[choice["$ref"].rsplit("/", 1)[1]], parts, where)
        elif isinstance(value, list) and "items" in choice:
            for each in value:
                yield from unknown_keys(each, choice["items"], parts, where)
        elif isinstance(value, dict) and "properties" in choice:
            for key, inner in value.items():
                if key not in choice["properties"]:
                    if choice.get("additionalProperties") is False:
                        yield where, key, list(choice["properties"])
                else:
                    yield from unknown_keys(inner, choice["properties"][key], parts, f"{where}{key}.")


def test_every_picture_is_made_by_a_command() -> None:
    makefile = (ROOT / "Makefile").read_text()
    for picture in (ROOT / "docs" / "images").iterdir():
        assert f"docs/images/{picture.name}" in makefile, f"`make pictures` does not make {picture.name}"
