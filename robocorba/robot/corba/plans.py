"""Conversion between RoboCorba::PlanRecord and Plan."""

from __future__ import annotations

from typing import Any

from robocorba.errors.robots import UnknownPlan
from robocorba.orb.exceptions import register
from robocorba.robot.data_pool.plans import Plan
from robocorba.stubs import RoboCorba


def record(plan: Plan) -> Any:
    return RoboCorba.PlanRecord(plan.name, plan.version, plan.content)


def plan_of(struct: Any) -> Plan:
    return Plan(struct.name, struct.current, struct.content)


register(UnknownPlan, RoboCorba.UnknownPlan, "name")
