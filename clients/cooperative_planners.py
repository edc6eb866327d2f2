"""The planners of cooperative icons: those of RoboCorba, and of other packages by entry points."""

from __future__ import annotations

from importlib.metadata import entry_points

from robocorba.errors.robots import MissionFailed
from robocorba.missions.cooperative_planner import MakePlanner
from robocorba.missions.hand_over import HandOverPlanner
from robocorba.missions.move_table import MoveTablePlanner
from robocorba.robot.programs import icons
from robocorba.robot.programs.icons import Icon, kind

#: The group of entry points that lead to planners, each with the tag of its icon as its name.
GROUP = "robocorba.cooperative_planners"

PLANNERS: dict[type[Icon], MakePlanner] = {
    icons.MoveTable: lambda icon, world, leader, here: MoveTablePlanner(world, icon.table, icon.to, icon.carriers),
    icons.HandOver: lambda icon, world, leader, here: HandOverPlanner(
        world, icon.object, icon.giver or leader, icon.taker, leader, here
    ),
}


def planner_of(icon: Icon) -> MakePlanner:
    """What makes the planner of an icon. Raises MissionFailed if there is none, or its package is damaged."""
    if type(icon) in PLANNERS:
        return PLANNERS[type(icon)]
    found = tuple(entry_points(group=GROUP, name=kind(icon)))
    if not found:
        raise MissionFailed(f"there is no planner for the cooperative icon {kind(icon)}: no entry point of {GROUP}")
    try:
        make: MakePlanner = found[0].load()
    except Exception as error:  # whatever the other package does
        raise MissionFailed(f"the planner of {kind(icon)} can't be loaded: {type(error).__name__}: {error}") from None
    return make
