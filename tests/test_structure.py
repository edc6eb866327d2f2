"""Who may import whom, read from the sources without running them."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
DOMAIN = (
    "robocorba/control/",
    "robocorba/data_pool/",
    "robocorba/kinematics/",
    "robocorba/maps/",
    "robocorba/missions/",
    "robocorba/planning/",
    "robocorba/programs/",
    "robocorba/smartpal/",
    "robocorba/events/",
    "robocorba/sensing/",
    "robocorba/simulation/",
    "robocorba/errors.py",
    "robocorba/frames.py",
)
SERVANTS = "robocorba/servants/"
#: What knows the classes that omniidl made: to translate, to derive from them, or to narrow to them.
STUBS_IN = (
    SERVANTS,
    "robocorba/conversion/",
    "robocorba/remote/",
    "robocorba/event_client.py",
    "robocorba/commands/",
    "robocorba/supervision/",
)
#: The package imports none of the programs that are built from it.
PROGRAMS = {"servers", "clients", "bench", "tests"}
CORBA = {"omniORB", "CosNaming", "CosEventComm", "CosEventChannelAdmin", "CORBA", "PortableServer"}
ABOVE_DOMAIN = {
    f"robocorba.{name}"
    for name in (
        "stubs",
        "servants",
        "commands",
        "orb",
        "naming",
        "calls",
        "conversion",
        "remote",
        "event_client",
        "supervision",
    )
}
#: Servants get what they need handed over.
AROUND_SERVANTS = {
    f"robocorba.{name}" for name in ("orb", "naming", "remote", "commands", "supervision", "settings", "logs")
}
#: Where the environment is read: our variables, and numba's own.
ENVIRONMENT_IN = ("robocorba/settings.py", "robocorba/kernels.py")


def faults(path: str, text: str) -> list[str]:
    """The rules that a source breaks; `path` is relative to the repository, with slashes."""
    tree = ast.parse(text)
    used = set(imports(path, tree))
    names = {node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
    names |= {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)} | {name.split(".")[-1] for name in used}
    words = {node.value for node in ast.walk(tree) if isinstance(node, ast.Constant) and isinstance(node.value, str)}

    found = [f"imports the program {name}" for name in within(used, PROGRAMS)]
    if path.startswith(DOMAIN):
        found += [f"domain code imports {name}" for name in within(used, CORBA | ABOVE_DOMAIN)]
    if path.startswith(SERVANTS):
        found += [f"a servant imports {name}" for name in within(used, {"robocorba.servants", *AROUND_SERVANTS})]
        taboo = {"ORB_init", "resolve", "string_to_object", "resolve_initial_references", "argv", "argparse"}
        found += [f"a servant uses {name}" for name in sorted(names & taboo)]
    if not path.startswith(STUBS_IN):
        found += [f"imports {name}, which conversion is for" for name in within(used, {"robocorba.stubs"})]
    if path != "robocorba/orb.py" and "ORB_init" in names:
        found.append("starts an ORB, which robocorba.orb is for")
    if not path.startswith(ENVIRONMENT_IN):
        found += [f"reads the environment by {name}" for name in sorted(names & {"environ", "getenv", "environb"})]
    if path != "robocorba/settings.py":
        variables = sorted(word for word in words if re.fullmatch("ROBOCORBA_[A-Z_]+", word))
        found += [f"knows {name}, which robocorba.settings is for" for name in variables]
    return found


def imports(path: str, tree: ast.Module) -> Iterator[str]:
    """Absolute names of what a module imports, wherever in it: `from a import b` gives a.b, which may be a module."""
    package = path.split("/")[:-1]
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            start = ".".join([*base, *filter(None, [node.module])])
            yield from (f"{start}.{alias.name}" for alias in node.names)


def within(used: set[str], packages: set[str]) -> list[str]:
    """Which of the names lie in one of the packages."""
    return sorted(name for name in used if any(f"{name}.".startswith(f"{package}.") for package in packages))


SOURCES = sorted(file for file in (ROOT / "robocorba").rglob("*.py") if "stubs" not in file.parts)


def test_all_parts_are_looked_at() -> None:
    looked_at = {file.relative_to(ROOT).as_posix() for file in SOURCES}
    for part in (*DOMAIN, SERVANTS, *STUBS_IN, *ENVIRONMENT_IN, "robocorba/orb.py"):
        assert any(file.startswith(part) for file in looked_at), part


@pytest.mark.parametrize("file", SOURCES, ids=lambda file: file.relative_to(ROOT).as_posix())
def test_every_source_keeps_the_rules(file: Path) -> None:
    assert faults(file.relative_to(ROOT).as_posix(), file.read_text()) == []


@pytest.mark.parametrize(
    ("path", "text", "fault"),
    [
        ("robocorba/maps/x.py", "from omniORB import CORBA", "domain code imports omniORB.CORBA"),
        ("robocorba/errors.py", "import CosNaming", "domain code imports CosNaming"),
        ("robocorba/planning/x.py", "def f():\n    from robocorba import orb", "domain code imports robocorba.orb"),
        ("robocorba/planning/x.py", "from .. import conversion", "domain code imports robocorba.conversion"),
        ("robocorba/maps/formats/x.py", "from ...servants.a import b", "domain code imports robocorba.servants.a.b"),
        ("robocorba/maps/x.py", "import robocorba.supervision", "domain code imports robocorba.supervision"),
        ("robocorba/maps/x.py", "import robocorba.commands.up as u", "domain code imports robocorba.commands.up"),
        ("robocorba/maps/x.py", "from robocorba.stubs import A", "domain code imports robocorba.stubs.A"),
        ("robocorba/servants/x.py", "from robocorba.servants import y", "a servant imports robocorba.servants.y"),
        ("robocorba/servants/x.py", "from .y import Z", "a servant imports robocorba.servants.y.Z"),
        ("robocorba/servants/x.py", "from robocorba.orb import Orb", "a servant imports robocorba.orb.Orb"),
        ("robocorba/servants/x.py", "import robocorba.naming", "a servant imports robocorba.naming"),
        ("robocorba/servants/x.py", "orb.resolve('PathPlanner', P)", "a servant uses resolve"),
        ("robocorba/servants/x.py", "import sys\nsys.argv", "a servant uses argv"),
        ("robocorba/servants/x.py", "from sys import argv", "a servant uses argv"),
        ("robocorba/servants/x.py", "CORBA.ORB_init([])", "a servant uses ORB_init"),
        ("robocorba/logs.py", "from servers import map_editor", "imports the program servers.map_editor"),
        ("robocorba/commands/x.py", "import clients.demo", "imports the program clients.demo"),
        ("robocorba/x.py", "from tests.maps import buildings", "imports the program tests.maps.buildings"),
        ("robocorba/x.py", "import bench", "imports the program bench"),
        ("robocorba/orb.py", "from robocorba.stubs import R", "imports robocorba.stubs.R, which conversion is for"),
        ("robocorba/commands/x.py", "CORBA.ORB_init([])", "starts an ORB, which robocorba.orb is for"),
        ("robocorba/commands/x.py", "from omniORB.CORBA import ORB_init", "starts an ORB, which robocorba.orb is for"),
        ("robocorba/logs.py", "import os\nos.environ['HOME']", "reads the environment by environ"),
        ("robocorba/logs.py", "from os import getenv", "reads the environment by getenv"),
        ("robocorba/logs.py", "f('ROBOCORBA_STATE')", "knows ROBOCORBA_STATE, which robocorba.settings is for"),
    ],
)
def test_each_rule_can_be_broken(path: str, text: str, fault: str) -> None:
    assert fault in faults(path, text)


@pytest.mark.parametrize(
    ("path", "text"),
    [
        ("robocorba/maps/x.py", "from robocorba.maps.model import Wall\nimport robocorba.errors"),
        ("robocorba/maps/x.py", "'not omniORB'  # import omniORB"),
        ("robocorba/servants/x.py", "from robocorba.stubs import RoboCorba__POA\nfrom robocorba import conversion"),
        ("robocorba/orb.py", "from omniORB import CORBA\nCORBA.ORB_init([])"),
        ("robocorba/settings.py", "import os\nos.environ['ROBOCORBA_STATE']"),
        ("robocorba/commands/x.py", "option(help='The state folder [ROBOCORBA_STATE].')"),
        ("robocorba/commands/x.py", "import testsuite, serversomething"),
    ],
)
def test_what_is_allowed(path: str, text: str) -> None:
    assert faults(path, text) == []
