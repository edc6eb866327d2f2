"""Conversion between IDL structs and domain values: states of sessions, adaptors and agents, commands, reports and
plans."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from robocorba.errors import robots as errors
from robocorba.errors.robots import AdaptorFailed
from robocorba.orb.exceptions import register, register_with
from robocorba.orb.structs import Converter, enumeration, struct_converter
from robocorba.robot.agent_state import AgentCondition, AgentState, IconBegun, ProgramReport, ProgramResult, RunReport
from robocorba.robot.data_pool.plans import Plan
from robocorba.robot.display import Display, DisplayKind
from robocorba.robot.motion.robot_state import ActorCommand, RobotState
from robocorba.robot.programs.report import CheckReport
from robocorba.robot.session import SessionState
from robocorba.simulation.corba.sessions import pose_of, ride_of
from robocorba.stubs import RoboCorba


def session_state_of(struct: Any) -> SessionState:
    moving = struct.moving
    return SessionState(
        struct.time,
        pose_of(struct.at),
        (moving.ahead, moving.left, moving.turn),
        struct.holding,
        ride_of(struct.riding),
        struct.collisions,
        struct.touched,
    )


def actor_state(state: RobotState) -> Any:
    return RoboCorba.ActorState(
        state.time,
        state.x,
        state.y,
        state.heading,
        RoboCorba.Velocity(*state.velocity),
        state.joints.tolist(),
        state.joint_velocities.tolist(),
    )


def fill(state: RobotState, struct: Any) -> None:
    """Copy an ActorState into a state."""
    state.time, state.x, state.y, state.heading = struct.time, struct.x, struct.y, struct.heading
    state.velocity = struct.moving.ahead, struct.moving.left, struct.moving.turn
    state.joints, state.joint_velocities = np.array(struct.joints), np.array(struct.jointVelocities)


def actor_state_of(struct: Any) -> RobotState:
    state = RobotState()
    fill(state, struct)
    return state


def actor_command(command: ActorCommand) -> Any:
    return RoboCorba.ActorCommand(
        RoboCorba.Velocity(*command.velocity),
        command.joints.tolist(),
        command.joint_velocities.tolist(),
        command.valid_s,
    )


def actor_command_of(struct: Any) -> ActorCommand:
    """Raises AdaptorFailed for an inconsistent or non-finite command."""
    wanted = struct.wanted
    velocity = wanted.ahead, wanted.left, wanted.turn
    joints, velocities = np.array(struct.joints, float), np.array(struct.jointVelocities, float)
    if len(joints) != len(velocities):
        raise AdaptorFailed(f"the command has {len(joints)} joints, but {len(velocities)} joint velocities")
    if not np.isfinite([*velocity, struct.validFor, *joints, *velocities]).all():
        raise AdaptorFailed("the command has a value that is not a finite number")
    return ActorCommand(velocity, joints, velocities, struct.validFor)


_REPORT = struct_converter(ProgramReport, RoboCorba.ProgramReport, result=enumeration(ProgramResult))
agent_state, agent_state_of = struct_converter(
    AgentState,
    RoboCorba.AgentState,
    {"tickJitter": "jitter_s"},
    condition=enumeration(AgentCondition),
    at=Converter(lambda pose: pose, pose_of),
    actor=Converter(actor_state, actor_state_of),
    program=_REPORT,
).both
_RUN = struct_converter(RunReport, RoboCorba.RunReport, program=_REPORT)
display, display_of = struct_converter(Display, RoboCorba.AgentDisplay, kind=enumeration(DisplayKind, "DISPLAY_")).both
begun, begun_of = struct_converter(IconBegun, RoboCorba.IconBegun).both
plan_record, plan_of = struct_converter(Plan, RoboCorba.PlanRecord, {"current": "version"}).both


def program_check(report: CheckReport) -> Any:
    """A ProgramCheck struct."""
    errors_found = [
        RoboCorba.ProgramFinding(RoboCorba.PROGRAM_ERROR, found.icon, found.parameter, found.reason)
        for found in report.findings
    ]
    notes = [RoboCorba.ProgramFinding(RoboCorba.PROGRAM_NOTE, note.icon, "", note.what) for note in report.notes]
    return RoboCorba.ProgramCheck([*errors_found, *notes], report.is_valid)


def program_check_of(struct: Any) -> CheckReport:
    report = CheckReport()
    for found in struct.findings:
        if found.kind == RoboCorba.PROGRAM_NOTE:
            report.add_note(found.icon, found.reason)
        else:
            report.add_finding(found.icon, found.parameter, found.reason)
    return report


def run_reports(reports: Sequence[RunReport], following: str) -> Any:
    """A RunReports struct. following: where the next call begins."""
    return RoboCorba.RunReports([_RUN.to_idl(report) for report in reports], following)


def run_reports_of(struct: Any) -> tuple[list[RunReport], str]:
    return [_RUN.from_idl(report) for report in struct.reports], struct.next


register(errors.FingerprintMismatch, RoboCorba.FingerprintMismatch, "part", "checked", "present")
register(errors.UnknownPlan, RoboCorba.UnknownPlan, "name")
register(errors.UnknownAdaptor, RoboCorba.UnknownAdaptor, "name", "known")
register(errors.AdaptorFailed, RoboCorba.AdaptorFailed, "cause")
for _kind in (errors.UnitFailed, errors.RobotLost, errors.ServerAway):
    register_with(_kind, RoboCorba.AdaptorFailed, lambda e: RoboCorba.AdaptorFailed(e.cause))
