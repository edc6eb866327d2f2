"""The plans of hand_over, and two robots that hand over an object."""

from __future__ import annotations

import contextlib
import math
import threading
from pathlib import Path

import msgspec
import pytest
import shapely

from robocorba.clients.cooperative_planners import PLANNERS
from robocorba.errors.robots import MissionFailed
from robocorba.map_editor.geometry import Obstacle
from robocorba.map_editor.model import Building, Floor
from robocorba.map_editor.spatial.frames import out_of
from robocorba.map_editor.spatial.pose import Pose
from robocorba.map_editor.topology import topological_map
from robocorba.missions.hand_over import BETWEEN_M, GIVING, TAKING, HandOverPlanner
from robocorba.missions.subplan import CooperativePlan, Gather
from robocorba.planning.request import Place as Spot
from robocorba.robot.kinematics.inverse import InverseKinematics
from robocorba.robot.kinematics.smartpal import GRIP, JOINTS, OPEN_RAD, RADIUS_M, SHUT_RAD
from robocorba.robot.kinematics.tasks import GRIP_DEPTH_M, SHEET_M
from robocorba.robot.programs import icons
from testkit.buildings import two_storeys
from tests.missions.places import Crew, MapWorld
from tests.robot.places import Place

pytestmark = pytest.mark.slow

ROBOTS = {"A": Spot("L1", 2.0, 1.5), "B": Spot("L1", 2.0, 5.5), "C": Spot("L2", 2.0, 5.5)}


@pytest.fixture(scope="module")
def world() -> MapWorld:
    return MapWorld(two_storeys())


def planned(world: MapWorld, giver: str, taker: str, leader: str = "A") -> CooperativePlan:
    return HandOverPlanner(world, "sheet", giver, taker, leader, ROBOTS[leader]).plan("m", leader, ROBOTS)


def meeting(plan: CooperativePlan) -> tuple[Gather, Gather]:
    giver, taker = (subplan.steps[0] for subplan in plan.subplans)
    assert isinstance(giver, Gather) and isinstance(taker, Gather)
    return giver, taker


@pytest.mark.parametrize(("giver", "taker"), [("A", "B"), ("B", "A"), ("A", "C"), ("C", "B")])
def test_they_meet_face_to_face(world: MapWorld, giver: str, taker: str) -> None:
    plan = planned(world, giver, taker)
    assert {subplan.robot: subplan.role for subplan in plan.subplans} == {giver: "giver", taker: "taker"}
    here, there = meeting(plan)
    assert here.floor == there.floor
    assert math.dist((here.x, here.y), (there.x, there.y)) == pytest.approx(BETWEEN_M)
    for one, other in ((here, there), (there, here)):
        facing = math.atan2(other.y - one.y, other.x - one.x)
        assert math.remainder(facing - one.heading, math.tau) == pytest.approx(0.0, abs=1e-9)


class Moved(MapWorld):
    """The box is now a long board between A and B, which the path between them has to avoid."""

    def others(self, carried: str) -> dict[str, list[Obstacle]]:
        return {"L1": [Obstacle("object", "box", BOARD)]}


BOARD = shapely.box(0.0, 3.0, 4.0, 4.0)


def test_they_meet_clear_of_moved_objects() -> None:
    here, there = meeting(planned(Moved(two_storeys()), "A", "B"))
    assert BOARD.distance(shapely.LineString([(here.x, here.y), (there.x, there.y)])) > RADIUS_M
    assert min(here.x, there.x) > BOARD.bounds[2] - 1.0


@pytest.mark.parametrize(
    ("icon", "required"), [(icons.HandOver("sheet", "B"), {"B"}), (icons.HandOver("sheet", "B", "C"), {"B", "C"})]
)
def test_the_leader_need_not_take_part(world: MapWorld, icon: icons.HandOver, required: set[str]) -> None:
    planner = PLANNERS[type(icon)](icon, world, "A", ROBOTS["A"])
    assert isinstance(planner, HandOverPlanner)
    assert (planner.required, planner.helpers) == (required, len(required))
    carriers = required if len(required) == 2 else {"A", *required}
    assert {subplan.robot for subplan in planner.plan("m", "A", ROBOTS).subplans} == carriers


def test_they_meet_half_way_and_impossible_hand_overs_are_refused(world: MapWorld) -> None:
    here, there = meeting(planned(world, "A", "B"))
    assert ((here.x + there.x) / 2, (here.y + there.y) / 2) == pytest.approx((2.0, 3.5), abs=0.8)
    assert math.dist((here.x, here.y), ROBOTS["A"][1:]) < math.dist((here.x, here.y), ROBOTS["B"][1:])
    with pytest.raises(MissionFailed, match="box stands in the building"):
        HandOverPlanner(world, "box", "A", "B", "A", ROBOTS["A"])
    with pytest.raises(MissionFailed, match="B can't hand sheet over to itself"):
        HandOverPlanner(world, "sheet", "B", "B", "A", ROBOTS["A"])


def test_they_meet_beside_a_path_without_room(world: MapWorld) -> None:
    """Both stand at the elevator, on different floors."""
    robots = {"A": Spot("L1", 7.44, 2.48), "B": Spot("L2", 7.5, 3.9)}
    here, there = meeting(HandOverPlanner(world, "sheet", "A", "B", "A", robots["A"]).plan("m", "A", robots))
    assert here.floor == there.floor
    assert min(math.dist((gather.x, gather.y), (7.44, 2.48)) for gather in (here, there)) < 3.0


def test_too_small_rooms_are_refused() -> None:
    outline = ((0.0, 0.0), (2.4, 0.0), (2.4, 2.0), (0.0, 2.0))
    building = Building("box room").with_element("", Floor(name="L1", level=1, elevation=0.0, outline=outline))
    building.floors["L1"] = msgspec.structs.replace(building.floors["L1"], topological=topological_map(building, "L1"))
    here, there = Spot("L1", 0.6, 1.0), Spot("L1", 1.6, 1.0)
    with pytest.raises(
        MissionFailed, match=r"no room for both face to face within 4 m of the path from A to B: 2\.6 m"
    ):
        HandOverPlanner(MapWorld(building), "sheet", "A", "B", "A", here).plan("m", "A", {"A": here, "B": there})


# ---- two robots ----


def test_two_robots_hand_a_sheet_over(tmp_path: Path) -> None:
    kinematics, ended = InverseKinematics(), threading.Event()
    apart, touching = list[float](), list[list[tuple[str, str]]]()

    def look(crew: Crew) -> None:
        while not ended.wait(0.2):
            giver, taker = (crew.agents[name].state.actor for name in ("A", "B"))
            touching.extend(found for each in (giver, taker) if (found := kinematics.body.collisions(each.joints)))
            both = ((giver, GIVING), (taker, TAKING))
            if all(abs(each.joints[GRIP[side]] - SHUT_RAD) < 0.01 for each, side in both):
                hands = []
                for each, side in both:
                    hand = kinematics.body.hand(side, each.joints)
                    hands.append((*out_of(hand.x, hand.y, (each.x, each.y, each.heading)), hand.z))
                apart.append(math.dist(*hands))

    robots = {"A": Pose("L1", 7.0, 2.4, 1.57), "B": Pose("L1", 7.0, 4.0, -1.57)}
    with contextlib.closing(Place(tmp_path)) as place, contextlib.closing(Crew(place, robots)) as crew:
        planner = HandOverPlanner(MapWorld(place.building), "sheet", "A", "B", "A", Spot(*robots["A"][:3]))
        thread = threading.Thread(target=look, args=(crew,))
        thread.start()
        report = crew.leader("A").lead("hand over", lambda: planner)
        ended.set()
        thread.join()
        assert (report.result, report.reason) == ("done", "")
        assert not touching
        assert apart == pytest.approx([SHEET_M - 2 * GRIP_DEPTH_M] * len(apart), abs=0.01) and apart
        a, b = (crew.agents[name].state.actor.joints for name in ("A", "B"))
        assert len(a) == len(JOINTS)
        assert (a[GRIP[GIVING]], b[GRIP[TAKING]]) == pytest.approx((OPEN_RAD, SHUT_RAD), abs=0.01)
