"""Carriers that lose one of them, or their leader, while they hold something."""

from __future__ import annotations

import math
import threading
from collections.abc import Collection, Iterator
from pathlib import Path

import pytest
from msgspec import structs
from shapely import Point

from robocorba.errors.robots import GoalReached
from robocorba.maps.model import BoxShape, MapObject
from robocorba.missions.cooperative_planner import CarriedBody
from robocorba.missions.leader import Inherited
from robocorba.missions.leader_policy import LeaderPolicy
from robocorba.missions.lookout import Seen
from robocorba.missions.member import MemberPolicy
from robocorba.missions.report import MissionReport, PhaseTimes
from robocorba.missions.subplan import Carry, CooperativePlan, Idle, PutDown, TakeHold, holding_steps
from robocorba.missions.trajectory import Trajectory
from robocorba.planning.request import Place as Spot
from robocorba.spatial.pose import Pose
from robocorba.testing.processes import eventually
from tests.control.places import Place
from tests.missions.places import Crew, Given
from tests.waits import patient

pytestmark = pytest.mark.slow

#: A and B stand at two sides of the box.
BOX = MapObject("box", BoxShape((0.6, 0.4)), (7.0, 3.0), height=0.8, movable=True)
ROBOTS = {"A": Pose("L1", 7.0, 2.18, math.pi / 2), "B": Pose("L1", 7.0, 3.82, -math.pi / 2)}
PLACES = {"A": (0.0, -0.82, math.pi / 2), "B": (0.0, 0.82, -math.pi / 2)}
GRIPS = {"A": (7.0, 2.8), "B": (7.0, 3.2)}
ROWS = Trajectory([(7.0, 3.0, 0.0), (8.2, 3.0, 0.0)]).to_rows()
LEADING = patient(
    LeaderPolicy(
        offer_timeout_s=1.0, surplus_offer_timeout_s=0.3, member_timeout_s=1.5, end_timeout_s=12.0, max_recoveries=1
    )
)
TAKING_PART = patient(
    MemberPolicy(
        leader_timeout_s=1.5,
        succession_timeout_s=0.5,
        holding_timeout_s=6.0,
        end_order_timeout_s=3.0,
        final_state_s=0.5,
        driving_posture="home",
    )
)


class Carried(Given):
    """Two robots carry the box eastwards. enough: of the plan."""

    def __init__(self, *enough: tuple[str, ...]) -> None:
        super().__init__(self._steps_of("A"), self._steps_of("B"))
        self._enough = enough

    @staticmethod
    def _steps_of(name: str) -> list[TakeHold | Carry | PutDown]:
        x, y = GRIPS[name]
        hold = TakeHold(thing="box", at=(7.0, 3.0, 0.0), x=x, y=y, height_m=0.7)
        return [hold, Carry(rows=ROWS, place=PLACES[name]), PutDown()]

    def plan(
        self, mission: str, leader: str, robots: dict[str, Spot], staying: Collection[str] = ()
    ) -> CooperativePlan:
        plan = super().plan(mission, leader, robots, staying)
        return structs.replace(plan, thing="box", enough=self._enough)


class Scene:
    """A leads B. planners: of its attempts; then the goal is reached."""

    def __init__(self, crew: Crew, *planners: Carried, leading: LeaderPolicy = LEADING) -> None:
        self.crew, self._leading = crew, leading
        self.plans: list[CooperativePlan] = []
        self.reports: list[MissionReport] = []
        self._planners = iter(planners)
        self._threads: list[threading.Thread] = []

    def lead(self, name: str, term: int = 1, inherited: Inherited | None = None) -> threading.Thread:
        def note(plan: CooperativePlan, phases: list[PhaseTimes], is_ending: bool) -> None:
            self.plans.append(plan)

        leader = self.crew.leader(name, self._leading, note, "carry", term, look=lambda: self._look(name))
        thread = threading.Thread(target=lambda: self.reports.append(leader.lead("test", self._planner, inherited)))
        self._threads.append(thread)
        thread.start()
        return thread

    def _planner(self) -> Carried:
        for planner in self._planners:
            return planner
        raise GoalReached("the box is at its goal")

    def _look(self, name: str) -> list[Seen]:
        """The robots on the floor."""
        robots = self.crew.pools[name].snapshot().robots
        return [Seen(each.name, True, Point(each.x, each.y).buffer(0.3), each.vx, each.vy) for each in robots]

    def box_x(self) -> float:
        return next(box.x for pool in self.crew.pools.values() if (box := pool.snapshot().object("box")))

    def until_carried(self) -> None:
        eventually(lambda: self.box_x() > 7.2, 60.0)

    def kill(self, name: str) -> None:
        """A robot is gone, as if its process had been killed."""
        self.crew.bus.disconnected = {name}
        session = self.crew.agents[name].session
        session.is_away = True
        session.log_off()

    def inherited(self) -> Inherited:
        """What the robots of A hold."""

        class Body(CarriedBody):
            pass

        return Inherited(self.plans[-1], Body())

    def result(self, thread: threading.Thread) -> MissionReport:
        thread.join(90.0)
        return self.reports[-1]


@pytest.fixture
def crew(tmp_path: Path) -> Iterator[Crew]:
    place = Place(tmp_path, BOX)
    crew = Crew(place, ROBOTS, LEADING, TAKING_PART)
    yield crew
    crew.bus.disconnected = set()
    crew.close()
    place.close()


def phases(report: MissionReport) -> list[str]:
    return [phase.name for phase in report.phases]


ALONE = Carried(("A",), ("B",))


def test_a_carrier_that_is_gone_is_not_needed(crew: Crew) -> None:
    scene = Scene(crew, ALONE)
    thread = scene.lead("A")
    scene.until_carried()
    scene.kill("B")
    report = scene.result(thread)
    assert (report.result, report.reason, report.faults) == ("done", "", ())
    assert phases(report) == ["phase 0", "phase 1", "phase 1 without B", "phase 2 without B"]
    assert scene.box_x() == pytest.approx(8.2, abs=0.02)
    eventually(lambda: crew.agents["A"].is_free, 60.0)


def test_another_leader_carries_on(crew: Crew) -> None:
    scene = Scene(crew, ALONE)
    first = scene.lead("A")
    scene.until_carried()
    scene.kill("A")
    eventually(lambda: crew.orphaned, 60.0)
    assert crew.orphaned == [("B", "carry", 1)]
    report = scene.result(scene.lead("B", 2, scene.inherited()))
    assert (report.leader, report.result, report.reason, report.faults) == ("B", "done", "", ())
    assert phases(report) == ["phase 1 without A", "phase 2 without A"]
    assert scene.box_x() == pytest.approx(8.2, abs=0.02)
    eventually(lambda: crew.agents["B"].is_free, 60.0)
    first.join(90.0)


def test_robots_hold_from_gripping_to_putting_down() -> None:
    plan = ALONE.plan("m", "A", {name: Spot(*at[:3]) for name, at in ROBOTS.items()})
    assert list(holding_steps(plan)) == [1, 2]
    assert not holding_steps(Given([Idle()], [Idle()]).plan("m", "A", {"A": Spot("L1", 0, 0), "B": Spot("L1", 1, 0)}))
