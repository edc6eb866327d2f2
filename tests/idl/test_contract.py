"""The IDL keeps what has been released, and its constants are the limits of the servers."""

from __future__ import annotations

import importlib.util
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from robocorba import __version__
from robocorba.events import event, queue, subscription
from robocorba.planning import request
from robocorba.robot import teleoperation
from robocorba.robot.data_pool import plans
from robocorba.robot.programs import program
from robocorba.simulation import picture, registry, reservations, simulated_robot, simulation_loop, store
from robocorba.simulation.sensing import fan, virtual_sensor
from robocorba.stubs import RoboCorba

pytestmark = [pytest.mark.system, pytest.mark.full]

IDL = Path(__file__).resolve().parents[2] / "idl"

BEFORE = """
module Demo {
  typedef sequence<string> Names;
  const unsigned long MOST = 3;
  enum Kind { ROUND, SQUARE };
  struct Part { string name; double width; };
  union Shape switch (Kind) { case ROUND: double radius; case SQUARE: Part side; };
  exception Refused { string reason; };
  interface Base { void reset(); };
  interface Shop : Base {
    readonly attribute string title;
    Part get(in string name, out long left) raises (Refused);
    oneway void note(in Names which);
  };
};
"""
#: What is replaced in the example, by what, and what is named then.
CHANGES = [
    ("double width;", "double width; double depth;", "IDL:Demo/Part:1.0"),
    ("double width;", "float width;", "IDL:Demo/Part:1.0"),
    ("string name; double width;", "double width; string name;", "IDL:Demo/Part:1.0"),
    ("double width;", "double breadth;", "IDL:Demo/Part:1.0"),
    ("ROUND, SQUARE", "ROUND, SQUARE, FLAT", "IDL:Demo/Kind:1.0"),
    ("case SQUARE: Part side", "case SQUARE: double side", "IDL:Demo/Shape:1.0"),
    ("string reason;", "string reason; long code;", "IDL:Demo/Refused:1.0"),
    ("sequence<string>", "sequence<string, 9>", "IDL:Demo/Names:1.0"),
    ("MOST = 3", "MOST = 4", "IDL:Demo/MOST:1.0"),
    ("out long left", "inout long left", "IDL:Demo/Shop/get:1.0"),
    ("in string name,", "in string name, in long kind,", "IDL:Demo/Shop/get:1.0"),
    ("raises (Refused)", "", "IDL:Demo/Shop/get:1.0"),
    ("Part get", "string get", "IDL:Demo/Shop/get:1.0"),
    ("void reset();", "", "IDL:Demo/Base/reset:1.0"),
    ("oneway void note", "void note", "IDL:Demo/Shop/note:1.0"),
    ("interface Shop : Base", "interface Shop", "IDL:Demo/Shop:1.0"),
    ("readonly attribute", "attribute", "IDL:Demo/Shop/title:1.0"),
    # What is new breaks nothing:
    ("void reset();", "void reset(); void start(in Kind how);", ""),
    ("in string name,", "in string its_name,", ""),
    ("interface Shop : Base", "interface Other { }; interface Shop : Base, Other", ""),
    ("enum Kind", "// a kind\n  typedef long Size; enum Kind", ""),
    ("exception Refused", "struct Size { long all; }; exception Refused", ""),
]


@pytest.fixture(scope="module")
def contract() -> ModuleType:
    """The module idl/contract.py, which is no part of the package."""
    sys.path.insert(0, str(IDL))
    try:
        spec = importlib.util.spec_from_file_location("contract", IDL / "contract.py")
        assert spec and spec.loader
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
    finally:
        sys.path.remove(str(IDL))
    return module


@pytest.fixture(scope="module")
def examples(
    contract: ModuleType, tmp_path_factory: pytest.TempPathFactory
) -> list[tuple[dict[str, str], dict[str, str]]]:
    """For each of CHANGES the signatures of the example before and after it: all are modules of one file."""
    texts = [BEFORE.replace(old, new, 1) for old, new, _ in CHANGES]
    file = tmp_path_factory.mktemp("idl") / "examples.idl"
    file.write_text("".join(text.replace("Demo", f"Demo{number}") for number, text in enumerate([BEFORE, *texts])))
    found: dict[int, dict[str, str]] = {}
    for declaration, signature in contract.signatures([str(file)]).items():
        number = int(re.match(r"IDL:Demo(\d+)", declaration)[1])  # type: ignore[index]
        plain = re.sub(rf"\bDemo{number}\b", "Demo", declaration), re.sub(rf"\bDemo{number}\b", "Demo", signature)
        found.setdefault(number, {}).__setitem__(*plain)
    return [(found[0], found[number]) for number in range(1, len(found))]


@pytest.mark.parametrize("release", [folder.name for folder in sorted((IDL / "released").iterdir())])
def test_clients_of_a_release_work(contract: ModuleType, release: str) -> None:
    released = contract.signatures(contract.idl_files(IDL / "released" / release))
    assert released
    assert contract.broken(released, contract.signatures(contract.idl_files(IDL))) == []


def test_the_program_says_what_a_change_breaks(tmp_path: Path) -> None:
    program = (sys.executable, str(IDL / "contract.py"))
    same = subprocess.run(program, capture_output=True, text=True, timeout=60)
    assert (same.returncode, same.stderr) == (0, "")
    (tmp_path / "names.idl").write_text("module RoboCorba { interface Gone { }; };")
    broken = subprocess.run((*program, str(tmp_path)), capture_output=True, text=True, timeout=60)
    assert (broken.returncode, broken.stderr) == (1, "IDL:RoboCorba/Gone:1.0 is gone; it was: interface :\n")


def test_the_last_release_is_this_one_or_earlier(contract: ModuleType) -> None:
    assert contract.numbers(contract.released().name) <= contract.numbers(__version__)


def test_what_breaks_clients_is_named(contract: ModuleType, examples: Any) -> None:
    for (before, now), change in zip(examples, CHANGES, strict=True):
        named = change[2]
        broken = [found.partition(" ")[0].rstrip(":") for found in contract.broken(before, now)]
        assert broken == [named] * bool(named), change
        assert contract.broken(now, now) == []


def test_constants_are_the_limits_of_the_servers() -> None:
    of_the_servers = {
        "MAX_NAME_LENGTH": event.MAX_NAME,
        "MAX_ALTERNATIVES": request.MAX_ALTERNATIVES,
        "MAX_FORBIDDEN_AREAS": request.MAX_AREAS,
        "MAX_PLANNED_RADIUS": request.MAX_RADIUS_M,
        "MAX_ROBOT_NAME_LENGTH": registry.MAX_NAME,
        "MAX_COMMAND_VALIDITY": simulated_robot.MAX_VALID_S,
        "MAX_JOINTS": simulated_robot.MAX_JOINTS,
        "MAX_RESERVED_AREAS": reservations.MAX_AREAS,
        "MAX_RESERVED_CORNERS": reservations.MAX_CORNERS,
        "MAX_RESERVED_ALTERNATIVES": reservations.MAX_ALTERNATIVES,
        "MAX_RESERVATION": reservations.MAX_LIMIT_S,
        "MIN_PICTURE_WIDTH": picture.MIN_WIDTH_PX,
        "MAX_PICTURE_WIDTH": picture.MAX_WIDTH_PX,
        "MAX_PACE": simulation_loop.MAX_PACE,
        "MAX_STEPS": simulation_loop.MAX_STEPS,
        "MAX_RAYS": fan.MAX_RAYS,
        "MAX_RAYS_OF_A_CALL": virtual_sensor.MAX_RAYS_AT_ONCE,
        "MAX_RANGE": fan.MAX_RANGE_M,
        "MAX_MISSION_DOCUMENT": store.MAX_DOCUMENT,
        "MAX_PLAN": plans.MAX_CONTENT,
        "MAX_PROGRAM": program.MAX_BYTES,
        "MAX_ICONS": program.MAX_ICONS,
        "MAX_DRIVE_VALIDITY": teleoperation.MAX_VALID_S,
        "MAX_PAYLOAD": event.MAX_PAYLOAD_BYTES,
        "MAX_CLAUSES": subscription.MAX_CLAUSES,
        "MAX_PATTERNS": subscription.MAX_PATTERNS,
        "MAX_QUEUE": queue.MAX_SIZE,
        "MAX_BLOCK_LIMIT": queue.MAX_BLOCK_S,
    }
    in_the_idl = {name: value for name, value in vars(RoboCorba).items() if name.startswith(("MAX_", "MIN_"))}
    assert in_the_idl == of_the_servers
