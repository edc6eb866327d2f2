"""A robot's part in a mission."""

from __future__ import annotations

from robocorba.missions.member import Member, MemberPolicy
from robocorba.missions.messages import Assignment
from robocorba.missions.subplan import BackOff, SubPlan
from robocorba.robot.robot import Robot
from tests.robot.collision_avoidance.crowd import Crowd
from tests.robot.collision_avoidance.test_giving_way import room


def test_a_part_that_ends_before_its_first_step_has_begun_none() -> None:
    crowd = Crowd(room(4.0, 2.0), {"A": (1.0, 1.0, 0.0)})
    subplan = SubPlan("A", "helper", (BackOff(distance_m=0.3),))
    task = Assignment(mission="m.1", leader="B", term=1, phases=("backing off",), subplan=subplan)
    members: list[Member] = []

    def take_part(robot: Robot) -> None:
        members.append(Member(task, robot, lambda thing: None, MemberPolicy(end_order_timeout_s=0.0)))
        robot.execution.abort("emergency stop")
        members[0].run()

    assert crowd.run(20.0, A=take_part) == {}
    report = members[0].report
    assert (report.reason, report.icons_done) == ("emergency stop", 0)  # unsigned in robot.idl
