"""Conversion of missions to RoboCorba::MissionState and back, and the errors of orders to robots.

Mission control passes these errors on, in a process that loads nothing else about robots."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import msgspec

from robocorba.errors import robots, simulation
from robocorba.orb.exceptions import register
from robocorba.orb.structs import enumeration, sequence, struct_converter
from robocorba.simulation.mission_record import (
    LeaderRecord,
    MemberRecord,
    MissionContent,
    MissionResult,
    MissionState,
    PhaseRecord,
)
from robocorba.stubs import RoboCorba

_leader, leader_of = struct_converter(LeaderRecord, RoboCorba.MissionLeader).both
_state, mission_state_of = struct_converter(
    lambda name, version, **content: MissionState(name, version, MissionContent(**content)),
    RoboCorba.MissionState,
    {"current": "version"},
    members=sequence(struct_converter(MemberRecord, RoboCorba.MissionMember)),
    phases=sequence(struct_converter(PhaseRecord, RoboCorba.MissionPhase)),
    result=enumeration(MissionResult, "MISSION_"),
).both  # of the IDL's, members of the record that are RECORD_ONLY have their defaults


def mission_state(state: MissionState) -> Any:
    content = msgspec.structs.asdict(state.content)
    flat: Any = SimpleNamespace(name=state.name, version=state.version, **content)
    return _state(flat)


def leaders(content: MissionContent) -> list[Any]:
    return [_leader(each) for each in content.all_leaders]


register(robots.InvalidProgram, RoboCorba.InvalidProgram, "icon", "parameter", "reason")
register(robots.IllegalOrder, RoboCorba.IllegalOrder, "order", "condition")
register(simulation.NoLeader, RoboCorba.NoLeader, "reason")
