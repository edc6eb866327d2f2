"""Two robots carry a box up, and one is killed in the cabin. What they show meanwhile on their touch panels a client,
the console, `robocorba watch` and `robocorba status` read in the same words."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator, Sequence
from itertools import groupby
from typing import Any

import pytest

from robocorba.console.system_state import SystemState
from robocorba.errors.services import NotReachable
from robocorba.missions.formation import HAND_M
from robocorba.robot.agent_state import AgentCondition
from robocorba.robot.corba.remote_data_pool import RemotePool
from robocorba.robot.display import DisplayKind
from robocorba.simulation.registry import Pose
from robocorba.system.repeating import Repeating
from testkit.buildings import two_storeys
from testkit.missions import MISSION_LIMIT_S, MissionSystem, RobotStart, missions
from testkit.processes import eventually, read_json

pytestmark = [pytest.mark.system, pytest.mark.slow(170), pytest.mark.full]

PATIENCE_S = 120.0
ORDER = "waiting", "waiting for an order"
CARRYING = {"A": RobotStart(4.2, 2.2, 0.785, "main"), "B": RobotStart(6.6, 4.8, -2.36, "main")}
#: The box.
START, GOAL = Pose("L1", 5.4, 3.5, -0.785), Pose("L2", 6.4, 3.5, -0.785)
#: The box at its goal, m and rad; its grips from the hands, m; how far from start and goal it is certainly carried, m.
NEAR_M, NEAR_RAD, SLIPPED_M, AWAY_M = 0.05, math.radians(3.0), 0.02, 0.1
LOOK_S = 0.2
#: Where the box and who is with it are at one moment.
Moment = dict[str, Pose]


class Viewers:
    """Who shows what the robots of `place` show."""

    def __init__(self, place: MissionSystem, console: SystemState) -> None:
        self.place, self._console = place, console

    def all_show(self, robot: str, kind: str, text: str) -> None:
        """Wait until they all do."""
        for viewer in (self.agent, self._console_page, self._watch, self._status):
            seen: list[Any] = []

            def shows(viewer: Callable[[str], Any] = viewer, seen: list[Any] = seen) -> bool:
                seen.append(viewer(robot))
                return seen[-1] in ((kind, text), text)

            with contextlib.suppress(AssertionError):
                eventually(shows, PATIENCE_S)
            assert seen[-1] in ((kind, text), text), list(dict.fromkeys(seen))

    def agent(self, robot: str) -> tuple[str, str]:
        shown = self.place.agent(robot).display()
        return shown.kind.name.lower(), shown.text

    def _console_page(self, robot: str) -> tuple[str, str] | None:
        row = self._console.rows()["robots"].get(robot, {"state": None})
        return (row["state"]["display"]["kind"], row["state"]["display"]["text"]) if row["state"] else None

    def _status(self, robot: str) -> tuple[str, str]:
        process = self.place.robocorba("viewer", "status", "--json", "--state", str(self.place.running.state))
        kind, text = read_json(process.communicate(timeout=PATIENCE_S)[0])["robots"].get(robot, ("", ""))
        return kind, text

    def _watch(self, robot: str) -> str:
        rows = read_json(self.place.printed("watch", "--json"))["robots"]
        return next(str(row["display"]) for row in rows if row["name"] == robot)


@pytest.fixture(scope="module")
def viewers(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Viewers]:
    with missions(tmp_path_factory.mktemp("floors"), two_storeys(), "main") as place:
        console = SystemState(place.orb)
        console.start()
        try:
            yield Viewers(place, console)
        finally:
            console.close()


class Truth:
    """How long robots stand and say that they work."""

    def __init__(self, place: MissionSystem) -> None:
        self._place = place
        self._lasts_s, self._before_s = dict.fromkeys(CARRYING, 0.0), dict.fromkeys(CARRYING, math.inf)
        self.most_s = 0.0

    def look(self, robot: str) -> None:
        agent = self._place.agent(robot)
        actor, shown = agent.state().actor, agent.display()
        is_moving = max(map(abs, (*actor.velocity, *actor.joint_velocities))) > 0.01
        is_true = is_moving or shown.kind is not DisplayKind.WORKING
        passed_s = max(0.0, actor.time - self._before_s[robot])
        self._lasts_s[robot] = 0.0 if is_true else self._lasts_s[robot] + passed_s
        self._before_s[robot], self.most_s = actor.time, max(self.most_s, self._lasts_s[robot])


def is_carried(moment: Moment) -> bool:
    """Whether the box is on its way for certain."""
    box = moment["box"]
    return all(box.floor != there.floor or math.dist(box[1:3], there[1:3]) > AWAY_M for there in (START, GOAL))


def hand(moment: Moment, robot: str) -> tuple[float, float]:
    """In the frame of the box, m."""
    box, base = moment["box"], moment[robot]
    x = base.x + HAND_M * math.cos(base.heading) - box.x
    y = base.y + HAND_M * math.sin(base.heading) - box.y
    c, s = math.cos(box.heading), math.sin(box.heading)
    return c * x + s * y, c * y - s * x


@pytest.mark.timeout(5 * MISSION_LIMIT_S)
def test_the_other_one_carries_on_alone_when_the_leader_is_killed_in_the_cabin(viewers: Viewers) -> None:
    """Until the leader is killed it is the example of docs/mission.md."""
    place, seen = viewers.place, list[Moment]()
    truth = Truth(place)

    def look() -> None:
        with contextlib.suppress(NotReachable):
            poses = place.poses()
            moment = {name: pose for name, pose in poses.items() if pose.floor == poses["box"].floor}
            if "B" in moment:
                seen.append(moment)

    def is_riding() -> bool:
        """By the record of mission control, which the one who carries on continues."""
        assert user.poll() is None, user.communicate()
        for name in CARRYING:
            truth.look(name)
        return any(phase.name == "riding" for state in place.missions_since(0) for phase in state.content.phases)

    place.start(CARRYING)
    user = place.mission("A", "box", f"L2:{GOAL.x},{GOAL.y},{GOAL.heading}")
    helper = place.agent("B")
    eventually(lambda: helper.display().text.startswith("gathering ("), PATIENCE_S, "B gathers")
    helper.pause()
    viewers.all_show("B", "waiting", f"paused: gathering (mission {place.led_by('A')}.1)")
    viewers.all_show("A", "waiting", "waiting for B")
    eventually(lambda: place.agent("A").display().seconds > 1.0, PATIENCE_S, "how long it has waited")
    helper.resume()
    with contextlib.closing(Repeating("watch", look, LOOK_S).start()):
        eventually(is_riding, MISSION_LIMIT_S, "riding")
        place.kill("A")
        code, out, err = place.outcome(user)
    assert (code, out.splitlines()[-1].split("\t")[0], err) == (0, "done", ""), out
    look()
    check_box(seen)
    assert truth.most_s < 10.0
    viewers.all_show("B", *ORDER)
    state = place.agent("B").state()
    assert (state.at.floor, state.condition) == ("L2", AgentCondition.IDLE)
    assert [body.name for body in RemotePool(place.orb, "B").content().came if body.name == "box"]
    (mission,) = place.control.missions_since(0)
    content = place.ended(mission.name)
    assert (content.leader, content.term) == ("B", 2)
    # On a busy machine a carry may wait for the positions of others.
    names = [phase.name for phase in content.phases if not phase.name.startswith("waiting: ")]
    assert [name for name, _ in groupby(names)] == [
        *("asking", "reserving", "gathering", "approaching", "gripping", "carrying", "waiting for the cabin"),
        *("driving in", "riding", "recovering", "riding without A", "driving out without A", "carrying without A"),
        *("putting down without A", "backing off without A"),
    ]


def check_box(seen: Sequence[Moment]) -> None:
    """It was never let go of on its way, and stands at its goal."""
    carried = [moment for moment in seen if is_carried(moment)]
    assert {moment["box"].floor for moment in carried} == {"L1", "L2"}
    assert len(carried) > 30
    together, alone = ([moment for moment in carried if ("A" in moment) is both] for both in (True, False))
    for robot, moments in (("A", together), ("B", together), ("B", alone)):
        grips = [hand(moment, robot) for moment in moments]
        assert max(math.dist(grip, grips[0]) for grip in grips) < SLIPPED_M
    box = seen[-1]["box"]
    assert box.floor == GOAL.floor
    assert math.dist(box[1:3], GOAL[1:3]) < NEAR_M
    assert abs(math.remainder(box.heading - GOAL.heading, math.tau)) < NEAR_RAD
