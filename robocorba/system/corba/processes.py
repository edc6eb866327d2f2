"""Conversion of processes and of orders to start robots from and to the IDL."""

from __future__ import annotations

from typing import Any

from robocorba.errors.services import ProcessExists, UnknownProcess
from robocorba.orb.exceptions import register
from robocorba.orb.structs import STRINGS, enumeration, struct_converter
from robocorba.stubs import RoboCorba
from robocorba.system.processes import ProcessPhase, ProcessState, RobotOrder

process_state, process_state_of = struct_converter(
    *(ProcessState, RoboCorba.ProcessState, {"processId": "pid"}),
    phase=enumeration(ProcessPhase, "PROCESS_"),
    bound_names=STRINGS,
).both


def robot_order(order: RobotOrder) -> Any:
    at = order.at or (0.0, 0.0, 0.0)
    arguments = list(order.adaptor_arguments)
    place = order.floor, order.at is not None, *at
    return RoboCorba.RobotOrder(order.name, order.adaptor, arguments, *place, order.channel)


def robot_order_of(struct: Any) -> RobotOrder:
    at = (struct.x, struct.y, struct.heading) if struct.isPlaced else None
    arguments = tuple(struct.adaptorArguments)
    return RobotOrder(struct.name, struct.adaptor, arguments, struct.onFloor, at, struct.channel)


register(ProcessExists, RoboCorba.ProcessExists, "name")
register(UnknownProcess, RoboCorba.UnknownProcess, "name")
