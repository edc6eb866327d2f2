"""Commands in the documents exist, with their options."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
import typer

from robocorba.commands import FORWARDING, SUBCOMMANDS, command

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
#: A command in code, or at the beginning of a line of a block.
_COMMAND = re.compile(r"(?:`|^ {4}|^|[;&|] )(?:\.venv/bin/)?robocorba ((?:[a-z0-9-]+ ?)+)([^`\n]*)", re.MULTILINE)


#: A file of the repository, and what only exists once it was made.
_FILE = re.compile(r"(?<![\w/.-])((?:bench|clients|docs|idl|robocorba|servers|tests)/[\w./-]*\w)")
_MADE = ("bench/results", "clients/cpp/build", "docs/api")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_file_exists(page: Path) -> None:
    named = {name for name in _FILE.findall(page.read_text()) if not name.startswith(_MADE)}
    assert sorted(name for name in named if not (ROOT / name).exists() and not (ROOT / f"{name}.py").exists()) == []


@pytest.fixture(scope="module")
def robocorba() -> Any:
    """The whole command, as its library sees it."""
    return typer.main.get_command(command())


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_command_exists(page: Path, robocorba: Any) -> None:
    for match in _COMMAND.finditer(page.read_text()):
        words, rest = match[1].split(), match[2]
        if words[0] not in SUBCOMMANDS and words[0] != "version":
            assert not match[0].startswith("`robocorba"), f"{page.name}: {match[0]}"
            continue
        found = robocorba
        for word in words:
            if not hasattr(found, "commands"):
                break
            assert word in found.commands, f"{page.name}: {match[0]}: there is no {word}"
            found = found.commands[word]
        if words[0] in FORWARDING or hasattr(found, "commands"):
            continue
        known = {option for parameter in found.params for option in (*parameter.opts, *parameter.secondary_opts)} | {
            "--help"
        }
        options = re.findall(r"(?<![\w-])--[a-z][a-z0-9-]*", rest.split(" #")[0].split(" -- ")[0])
        unknown = [option for option in options if option not in known]
        assert not unknown, f"{page.name}: {match[0]}: there is no {', '.join(unknown)}"
