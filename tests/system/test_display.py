"""What robots show on their touch panels: a client, the console and `robocorba watch` read the same words."""

from __future__ import annotations

import contextlib
import math
import subprocess
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from robocorba.console.system_state import SystemState
from robocorba.robot.display import DisplayKind
from robocorba.robot.programs import program
from robocorba.robot.programs.graphic_programming import ProgramBuilder
from testkit.buildings import two_storeys
from testkit.missions import MISSION_LIMIT_S, MissionSystem, RobotStart, missions
from testkit.processes import ROBOCORBA, eventually, read_json

pytestmark = [pytest.mark.system, pytest.mark.slow, pytest.mark.full]

PATIENCE_S = 120.0
ORDER = "waiting", "waiting for an order"
ROBOTS = {
    "A": RobotStart(3.8, 2.0, 0.0, "lab"),
    "B": RobotStart(5.5, 6.2, 0.0, "lab"),
    "C": RobotStart(4.5, 3.5, 0.0, "lab", floor="L2"),
    "D": RobotStart(1.0, 6.0, 0.0, "lab"),
    "E": RobotStart(3.5, 3.5, 0.0, "lab", floor="L2"),
}


class Viewers:
    """Who shows what the robots of `place` show."""

    def __init__(self, place: MissionSystem, console: SystemState) -> None:
        self.place, self._console = place, console

    def all_show(self, robot: str, kind: str, text: str) -> None:
        """Wait until they all do."""
        for viewer in (self._agent, self._console_page, self._watch, self._status):
            seen: list[Any] = []

            def shows(viewer: Callable[[str], Any] = viewer, seen: list[Any] = seen) -> bool:
                seen.append(viewer(robot))
                return seen[-1] in ((kind, text), text)

            with contextlib.suppress(AssertionError):
                eventually(shows, PATIENCE_S)
            assert seen[-1] in ((kind, text), text), list(dict.fromkeys(seen))

    def _agent(self, robot: str) -> tuple[str, str]:
        shown = self.place.agent(robot).display()
        return shown.kind.name.lower(), shown.text

    def _console_page(self, robot: str) -> tuple[str, str] | None:
        row = self._console.rows()["robots"].get(robot, {"state": None})
        return (row["state"]["display"]["kind"], row["state"]["display"]["text"]) if row["state"] else None

    def _status(self, robot: str) -> tuple[str, str]:
        command = (ROBOCORBA, "status", "--json", "--state", str(self.place.running.state))
        answer = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S)
        kind, text = read_json(answer.stdout)["robots"].get(robot, ("", ""))
        return kind, text

    def _watch(self, robot: str) -> str:
        rows = read_json(self.place.printed("watch", "--json"))["robots"]
        return next(str(row["display"]) for row in rows if row["name"] == robot)


@pytest.fixture(scope="module")
def viewers(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Viewers]:
    """The cabin takes two minutes and a half from floor to floor."""
    with missions(tmp_path_factory.mktemp("display"), two_storeys(speed=0.02), "lab") as place:
        place.start(ROBOTS)
        console = SystemState(place.orb)
        console.start()
        try:
            yield Viewers(place, console)
        finally:
            console.close()


def test_who_waits_for_another_robot_of_its_mission_says_so(viewers: Viewers) -> None:
    place = viewers.place
    user = place.mission("A", "box", "L1:3.4,3.5")
    other = place.agent("B")
    eventually(lambda: other.display().text.startswith("gathering ("), PATIENCE_S, "B gathers")
    other.pause()
    viewers.all_show("B", "waiting", f"paused: gathering (mission {place.led_by('A')}.1)")
    viewers.all_show("A", "waiting", "waiting for B")
    assert place.agent("A").display().seconds > 1.0
    other.resume()
    stands_s = {name: [0.0, 0.0] for name in "AB"}  # how long it stands and says that it works; and the most [s]
    before_s = dict.fromkeys("AB", math.inf)

    def is_over() -> bool:
        for name, (lasts_s, most_s) in stands_s.items():
            agent = place.agent(name)
            actor, shown = agent.state().actor, agent.display()
            is_moving = max(map(abs, (*actor.velocity, *actor.joint_velocities))) > 0.01
            is_true = is_moving or shown.kind is not DisplayKind.WORKING
            lasts_s = 0.0 if is_true else lasts_s + max(0.0, actor.time - before_s[name])
            before_s[name], stands_s[name] = actor.time, [lasts_s, max(most_s, lasts_s)]
        return user.poll() is not None

    eventually(is_over, MISSION_LIMIT_S, "the end of the mission")
    assert max(most_s for _, most_s in stands_s.values()) < 10.0
    viewers.all_show("B", *ORDER)
    assert place.outcome(user)[0] == 0


def test_who_waits_for_an_elevator_says_so_until_an_emergency_stop(viewers: Viewers) -> None:
    """The cabin goes to C first."""
    for robot, floor, awaited in (("C", "L1", "elevator E1"), ("D", "L2", "elevator E1, 1 ahead")):
        agent = viewers.place.agent(robot)
        agent.load(program.dumps(ProgramBuilder("ride").mbase_path(floor, 2.0, 3.5).program()))
        agent.run()
        viewers.all_show(robot, "waiting", f"waiting for {awaited}")
    agent = viewers.place.agent("C")
    agent.stop()
    viewers.all_show("C", "exceptional", "stopped: emergency stop")
    agent.reset_stop()
    viewers.all_show("C", *ORDER)
