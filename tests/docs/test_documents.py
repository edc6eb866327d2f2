"""Documents name files, commands and messages that exist, and say something of everything in the Python API."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
import re
import runpy
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
import typer

from robocorba.commands import SUBCOMMANDS, command

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
#: The modules of the reference.
MODULES = runpy.run_path(str(ROOT / "docs" / "make_api.py"))["MODULES"]
#: A command in code, or at the beginning of a line of a block.
_COMMAND = re.compile(r"(?:`|^ {4}|^|[;&|] )(?:\.venv/bin/)?robocorba ((?:[a-z0-9-]+ ?)+)([^`\n]*)", re.MULTILINE)
#: A file of the repository, and what only exists once it was made.
_FILE = re.compile(r"(?<![\w/.-])((?:bench|clients|docs|idl|robocorba|servers|tests)/[\w./-]*\w)")
_MADE = ("bench/results", "clients/cpp/build", "docs/site")
#: Messages of others in docs/troubleshooting.md: omniORB's, and the form of all messages about map files.
_FOREIGN = re.compile(r"CORBA\.|COMM_FAILURE|TRANSIENT_|FILE:LINE")


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
        if hasattr(found, "commands"):
            continue
        known = {option for parameter in found.params for option in (*parameter.opts, *parameter.secondary_opts)} | {
            "--help"
        }
        options = re.findall(r"(?<![\w-])--[a-z][a-z0-9-]*", rest.split(" #")[0].split(" -- ")[0])
        unknown = [option for option in options if option not in known]
        assert not unknown, f"{page.name}: {match[0]}: there is no {', '.join(unknown)}"


def messages() -> list[str]:
    """Those that the page about trouble quotes, in the first column of its tables."""
    rows = [line for line in (ROOT / "docs" / "troubleshooting.md").read_text().splitlines() if line.startswith("| ")]
    return [quoted for row in rows for quoted in re.findall(r"`([^`]+)`", row.split(" | ")[0])]


def test_messages_are_ours() -> None:
    quoted = messages()
    files = [*(ROOT / "robocorba").rglob("*.py"), *(ROOT / "servers").glob("*.py"), ROOT / "Makefile"]
    # A text that continues on the next line is in one piece.
    source = "\n".join(re.sub(r'"\s*\n\s*f?"', "", file.read_text()) for file in files)
    parts = {part.strip(" ,:") for each in quoted for part in _FOREIGN.split(each)[0].removesuffix("(").split("...")}
    assert [part for part in parts if part not in source] == []
    assert len(quoted) > 30


def modules() -> Iterator[ModuleType]:
    """Those of the reference, with their sub-modules."""
    for name in MODULES:
        module = importlib.import_module(name)
        yield module
        for found in pkgutil.walk_packages(getattr(module, "__path__", []), f"{name}."):
            yield importlib.import_module(found.name)


@pytest.mark.parametrize("module", list(modules()), ids=lambda module: module.__name__)
def test_what_is_public_has_a_docstring(module: ModuleType) -> None:
    assert module.__doc__
    own = [
        (name, value)
        for name, value in vars(module).items()
        if not name.startswith("_") and getattr(value, "__module__", None) == module.__name__
    ]
    silent = [
        name for name, value in own if (inspect.isclass(value) or inspect.isfunction(value)) and not value.__doc__
    ]
    assert not silent, f"{module.__name__}: {', '.join(silent)}"
