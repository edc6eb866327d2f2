"""Two robots carry a box up one floor: real processes, one command, and the elevator that they all ride together. The
leader is killed in the cabin, and the other one carries on.

Until then it is the example of docs/mission.md."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator
from itertools import groupby
from subprocess import Popen
from typing import NamedTuple

import pytest

from robocorba.claimed_ports import claimed_ports
from robocorba.control.agent_state import AgentCondition
from robocorba.corba.orb import Orb
from robocorba.corba.remote.control_agent import RemoteAgent
from robocorba.corba.remote.data_pool import RemotePool
from robocorba.corba.remote.mission_control import RemoteMissionControl
from robocorba.corba.remote.omni_database import RemoteDatabase
from robocorba.errors.services import NotReachable
from robocorba.maps import native
from robocorba.missions.formation import HAND_M
from robocorba.repeating import Repeating
from robocorba.simulation.mission_record import MissionContent
from robocorba.simulation.registry import Pose
from robocorba.spatial.floor_update import WHOLE
from robocorba.testing.buildings import two_storeys
from robocorba.testing.processes import ROBOCORBA, Launcher, drain, eventually, real_system

pytestmark = [pytest.mark.system, pytest.mark.slow, pytest.mark.full]

PATIENCE_S = 250.0
START, GOAL = Pose("L1", 5.4, 3.5, -0.785), Pose("L2", 6.4, 3.5, -0.785)
#: The box at its goal, m and rad; its grips from the hands, m; how far from start and goal it is certainly carried, m.
NEAR_M, NEAR_RAD, SLIPPED_M, AWAY_M = 0.05, math.radians(3.0), 0.02, 0.1
LOOK_S = 0.2


class Seen(NamedTuple):
    """Where all are at one moment."""

    floor: str
    poses: dict[str, Pose]

    def is_carried(self) -> bool:
        """Whether the box is on its way for certain."""
        box = self.poses["box"]
        return all(box.floor != there.floor or math.dist(box[1:3], there[1:3]) > AWAY_M for there in (START, GOAL))

    def hand(self, robot: str) -> tuple[float, float]:
        """In the frame of the box, m."""
        box, base = self.poses["box"], self.poses[robot]
        x = base.x + HAND_M * math.cos(base.heading) - box.x
        y = base.y + HAND_M * math.sin(base.heading) - box.y
        c, s = math.cos(box.heading), math.sin(box.heading)
        return c * x + s * y, c * y - s * x


class Watch:
    """Looks at both floors again and again. `seen`: what was together on one of them."""

    def __init__(self, orb: Orb) -> None:
        self._database = RemoteDatabase(orb, 5.0)
        self.seen: list[Seen] = []

    def look(self) -> None:
        for floor in ("L1", "L2"):
            with contextlib.suppress(NotReachable):
                update = self._database.changes(floor, WHOLE)
                names = {body.number: body.name for body in update.came}
                poses = {
                    names[int(row["number"])]: Pose(floor, float(row["x"]), float(row["y"]), float(row["heading"]))
                    for row in update.motions
                }
                if poses.keys() >= {"B", "box"}:
                    self.seen.append(Seen(floor, poses))


class Carry(NamedTuple):
    """A mission that runs. leader: the robot's process."""

    orb: Orb
    watch: Watch
    user: Popen[str]
    leader: Popen[str]

    def mission(self) -> MissionContent:
        """What mission control says of it."""
        (state,) = RemoteMissionControl(self.orb, 5.0).missions_since(0)
        return state.content

    def wait_for(self, floor: str) -> None:
        """Wait until the box is carried on a floor."""

        def is_there() -> bool:
            assert self.user.poll() is None, self.user.communicate()
            return any(moment.floor == floor and moment.is_carried() for moment in self.watch.seen)

        eventually(is_there, PATIENCE_S, f"carried on {floor}")


@pytest.fixture(scope="module")
def carry(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Carry]:
    folder = tmp_path_factory.mktemp("floors")
    native.save(two_storeys(), folder / "two-storeys.yaml")
    with claimed_ports() as port, Launcher(folder) as launch:
        running = real_system(launch, folder / "state", port, "--building", "two-storeys.yaml").wait_ready()
        drain(running.process)
        place = {"ROBOCORBA_NAMING": str(running.naming), "ROBOCORBA_STATE": str(folder / "robots")}
        robots = [
            launch(ROBOCORBA, "robot", name, "--floor", "L1", "--at", at, "--channel", "main", **place)
            for name, at in (("A", "4.2,2.2,0.785"), ("B", "6.6,4.8,-2.36"))
        ]
        for robot in robots:
            assert robot.stdout is not None and robot.stderr is not None
            assert robot.stdout.readline() == "ready\n", robot.stderr.read()
            drain(robot)
        to = f"L2:{GOAL.x},{GOAL.y},{GOAL.heading}"
        command = ("mission", "start", "move-table", "--table", "box", "--to", to, "--leader", "A")
        with Orb(running.naming) as orb:
            watch = Watch(orb)
            with contextlib.closing(Repeating("watch", watch.look, LOOK_S).start()):
                yield Carry(orb, watch, launch(ROBOCORBA, *command, **place), robots[0])


@pytest.mark.timeout(4 * PATIENCE_S)
def test_the_other_one_carries_on_alone_when_the_leader_is_killed_in_the_cabin(carry: Carry) -> None:
    carry.wait_for("L1")

    def is_riding() -> bool:
        assert carry.user.poll() is None, carry.user.communicate()
        phases = carry.mission().phases
        return bool(phases) and phases[-1].name == "riding"

    eventually(is_riding, PATIENCE_S, "riding")
    carry.leader.kill()
    carry.wait_for("L2")
    out, err = carry.user.communicate(timeout=PATIENCE_S)
    assert (out.splitlines()[-1].split("\t")[0], err) == ("done", ""), out
    carry.watch.look()
    state = RemoteAgent(carry.orb, "B").state()
    assert (state.at.floor, state.condition) == ("L2", AgentCondition.IDLE)
    assert [body.name for body in RemotePool.of_robot(carry.orb, "B").content().came if body.name == "box"]
    check_box(carry.watch.seen)
    check_record(carry.mission())


def check_box(seen: list[Seen]) -> None:
    """It was never let go of on its way, and stands at its goal."""
    carried = [moment for moment in seen if moment.is_carried()]
    assert {moment.floor for moment in carried} == {"L1", "L2"}
    assert len(carried) > 30
    for robot in ("A", "B"):
        grips = [moment.hand(robot) for moment in carried if {"A", "B"} <= moment.poses.keys()]
        assert max(math.dist(grip, grips[0]) for grip in grips) < SLIPPED_M
    grips = [moment.hand("B") for moment in carried if "A" not in moment.poses]
    assert max(math.dist(grip, grips[0]) for grip in grips) < SLIPPED_M
    box = seen[-1].poses["box"]
    assert box.floor == GOAL.floor
    assert math.dist(box[1:3], GOAL[1:3]) < NEAR_M
    assert abs(math.remainder(box.heading - GOAL.heading, math.tau)) < NEAR_RAD


def check_record(content: MissionContent) -> None:
    assert (content.leader, content.term) == ("B", 2)
    # On a busy machine a carry may wait for the positions of others.
    names = [phase.name for phase in content.phases if not phase.name.startswith("waiting: ")]
    assert [name for name, _ in groupby(names)] == [
        *("asking", "reserving", "gathering", "approaching", "gripping", "carrying", "waiting for the cabin"),
        *("driving in", "riding", "recovering", "riding without A", "driving out without A", "carrying without A"),
        *("putting down without A", "backing off without A"),
    ]
