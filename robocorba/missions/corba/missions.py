"""Conversion of missions to RoboCorba::MissionState and back, and the errors of orders to robots.

Mission control passes these errors on, in a process that loads nothing else about robots."""

from __future__ import annotations

from typing import Any

from robocorba.errors import robots, simulation
from robocorba.orb.exceptions import register
from robocorba.simulation.mission_record import (
    LeaderRecord,
    MemberRecord,
    MissionContent,
    MissionResult,
    MissionState,
    PhaseRecord,
)
from robocorba.stubs import RoboCorba

_RESULTS = {result: getattr(RoboCorba, f"MISSION_{result.name}") for result in MissionResult}
_RESULT_OF = {struct: result for result, struct in _RESULTS.items()}


def mission_state(state: MissionState) -> Any:
    content = state.content
    return RoboCorba.MissionState(
        state.name,
        state.version,
        content.kind,
        content.about,
        content.leader,
        content.term,
        [RoboCorba.MissionMember(member.robot, member.role) for member in content.members],
        [RoboCorba.MissionPhase(each.name, each.begun, each.ended, each.waited_for) for each in content.phases],
        content.phases_in_all,
        content.begun,
        content.ended,
        _RESULTS[content.result],
        content.reason,
    )


def mission_state_of(struct: Any) -> MissionState:
    """The state; members of the record that are RECORD_ONLY have their defaults."""
    content = MissionContent(
        kind=struct.kind,
        about=struct.about,
        leader=struct.leader,
        term=struct.term,
        members=tuple(MemberRecord(member.robot, member.role) for member in struct.members),
        phases=tuple(PhaseRecord(each.name, each.begun, each.ended, each.waitedFor) for each in struct.phases),
        phases_in_all=struct.phasesInAll,
        begun=struct.begun,
        ended=struct.ended,
        result=_RESULT_OF[struct.result],
        reason=struct.reason,
    )
    return MissionState(struct.name, struct.current, content)


def leaders(content: MissionContent) -> list[Any]:
    return [RoboCorba.MissionLeader(each.robot, each.term, each.since, each.reason) for each in content.all_leaders]


def leader_of(struct: Any) -> LeaderRecord:
    return LeaderRecord(struct.robot, struct.term, struct.since, struct.reason)


register(robots.InvalidProgram, RoboCorba.InvalidProgram, "icon", "parameter", "reason")
register(robots.IllegalOrder, RoboCorba.IllegalOrder, "order", "condition")
register(simulation.NoLeader, RoboCorba.NoLeader, "reason")
