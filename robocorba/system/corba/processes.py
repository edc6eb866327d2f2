"""Conversion of processes and of orders to start robots from and to the IDL."""

from __future__ import annotations

from typing import Any

from robocorba.errors.services import ProcessExists, UnknownProcess
from robocorba.orb.exceptions import register
from robocorba.stubs import RoboCorba
from robocorba.system.processes import ProcessPhase, ProcessState, RobotOrder

_PHASES = {phase: getattr(RoboCorba, f"PROCESS_{phase.name}") for phase in ProcessPhase}
_PHASE_OF = {struct: phase for phase, struct in _PHASES.items()}


def process_state(state: ProcessState) -> Any:
    return RoboCorba.ProcessState(
        state.name, _PHASES[state.phase], state.pid, state.restarts, state.since, list(state.bound_names), state.problem
    )


def process_state_of(struct: Any) -> ProcessState:
    return ProcessState(
        struct.name,
        _PHASE_OF[struct.phase],
        struct.processId,
        struct.restarts,
        struct.since,
        tuple(struct.boundNames),
        struct.problem,
    )


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
