"""Sessions of robots, and what is left of them when processes are killed: the simulation server, sensor servers,
robots."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest
from omniORB import CORBA

from robocorba.stubs import RoboCorba
from testkit.processes import eventually
from testkit.simulation import (
    BACK_LIMIT_S,
    GONE,
    Chaos,
    Place,
    away,
    error_lines,
    simulation,
)

pytestmark = [pytest.mark.system, pytest.mark.slow(30), pytest.mark.full]

ROUNDS = 2
#: Ten times what the bench allows [s]: a machine that is busy with other tests writes later.
BUSY_LOST_S = 2.0


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Place]:
    with simulation(tmp_path_factory.mktemp("simulation"), sensors=2) as place:
        yield place
        assert [line for line in error_lines(place.running.state) if "ended by SIGKILL" not in line] == []


@pytest.fixture
def place(whole: Place) -> Iterator[Place]:
    yield whole
    whole.let_go()
    whole.administrator.setPace(1.0)


def test_who_is_killed_makes_room_and_nobody_else_loses_anything(place: Place) -> None:
    """With more rounds and a table: python -m bench.simulation.chaos"""
    with contextlib.closing(Chaos(place, seed=1, lost_s=BUSY_LOST_S)) as chaos:
        for _ in range(ROUNDS):
            outcome = chaos.round()
            assert outcome.is_right, outcome
    assert {process.state for process in place.running.record().processes} == {"running"}


class StateFile(NamedTuple):
    """content: empty for a folder. mode: the permissions."""

    path: Path
    content: bytes
    mode: int


def state_files(folder: Path) -> list[StateFile]:
    """Of the state folder of a running system, and of all that is in it; without what has gone since it was listed."""
    found = []
    for path in (folder, *folder.rglob("*")):
        with contextlib.suppress(FileNotFoundError):
            content = path.read_bytes() if path.is_file() else b""
            found.append(StateFile(path, content, path.stat().st_mode & 0o777))
    return found


def test_a_robot_whose_floor_went_and_that_logged_on_elsewhere_outlives_the_server(place: Place) -> None:
    floor = RoboCorba.Element(aFloor=RoboCorba.Floor("roof", 9, 40.0, 3.0, []))
    version = place.editor.create("", floor)
    eventually(lambda: "roof" in place.database.floors())
    before = place.log_on("a", 3.0, 3.0, floor="roof")
    place.editor.remove(RoboCorba.ElementId(RoboCorba.FLOOR_ELEMENT, "", "roof"), version)
    eventually(lambda: "roof" not in place.database.floors())
    with pytest.raises(CORBA.OBJECT_NOT_EXIST):
        before.state()
    a = place.log_on("a", 3.0, 12.0)
    began = a.state().time
    eventually(lambda: a.state().time > began + 0.5, what="all is written")
    place.kill("simulation")

    def answers() -> bool:
        with contextlib.suppress(*GONE):
            return away(a.state(), RoboCorba.Pose("L1", 3.0, 12.0, 0.0)) == 0.0
        return False

    eventually(answers, BACK_LIMIT_S, "the robot is back")
    assert "a" in place.names
    with pytest.raises(CORBA.OBJECT_NOT_EXIST):
        before.state()
    # The administrator's reference is still valid, too; secrets are nowhere but in its file, and with the robots.
    place.administrator.setLimit(300)
    for reference, prefix in ((a, b"sessions/"), (place.administrator, b"administrator/")):
        known = bytes.fromhex(place.orb.uri(reference).removeprefix("IOR:"))
        secret = known.partition(prefix)[2][:32]
        assert len(set(secret)) > 10
        files = state_files(place.running.state)
        assert [file.path.name for file in files if secret in file.content] == []
    assert [file.path.name for file in files if file.mode & 0o077] == []
