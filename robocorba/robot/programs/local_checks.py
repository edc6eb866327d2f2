"""Which icons need servers of the building, so that an agent on the robot's computer refuses them before the run."""

from __future__ import annotations

from robocorba.robot.programs.icons import (
    Branch,
    CooperativeIcon,
    Event,
    Gripper,
    Holding,
    Icon,
    MbasePath,
    Say,
    WaitUntil,
)
from robocorba.robot.programs.program import Program, icons_with_paths
from robocorba.robot.programs.report import CheckReport


def check_without_servers(program: Program, floor: str, has_channel: bool) -> CheckReport:
    """Findings for what the agent of a robot on this floor can't do by itself. has_channel: it has an event channel."""
    report = CheckReport()
    for path, icon in icons_with_paths(program):
        if parameter := _what_needs_servers(icon, floor, has_channel):
            report.add_finding(path, *parameter)
    return report


def _what_needs_servers(icon: Icon, floor: str, has_channel: bool) -> tuple[str, str] | None:
    """The parameter that needs a server, and why."""
    condition = icon.condition if isinstance(icon, WaitUntil | Branch) else None
    if isinstance(icon, CooperativeIcon):
        return "icon", "a mission needs the building's servers, and this agent runs without them"
    if isinstance(icon, MbasePath) and icon.floor != floor:
        return "floor", f"an elevator ride needs the simulation server, and this agent drives on {floor} without it"
    if isinstance(icon, Gripper) and icon.object:
        return "object", "the simulation server knows objects, and this agent runs without it; leave it out"
    if isinstance(condition, Holding):
        return "condition", "the simulation server knows what hands hold, and this agent runs without it"
    if not has_channel and (isinstance(icon, Say) or isinstance(condition, Event)):
        return "icon", "events need an event channel, and this agent has none: start it with --channel"
    return None
