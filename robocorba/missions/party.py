"""The robots of a mission: who is near and free, whether they suffice, and who would come if it began now."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from types import MappingProxyType

from robocorba.errors.robots import InTheWay, MissionFailed
from robocorba.missions.cooperative_planner import CooperativePlanner
from robocorba.missions.leader_policy import DEFAULT_POLICY
from robocorba.planning.request import Place


def party_of(
    make_planner: Callable[[str, Place], CooperativePlanner], free: Mapping[str, Place], leader: str = ""
) -> tuple[list[str], list[str]]:
    """Who would come if a mission began now, the leader first, and others that would be asked to step aside: planned as
    its leader would, without asking any robot.

    make_planner: from the leader's name and place. free: the places of all free robots. leader: empty for the nearest
    one. Raises MissionFailed, ImpossibleCarry, InvalidPlan, PathError, NotReachable."""
    if not free:
        raise MissionFailed("no robot is free")
    if leader and leader not in free:
        raise MissionFailed(f"{leader} is not free")
    planner = make_planner(leader or min(free), free[leader or min(free)])
    nearest = nearest_first(planner, free)
    leader = leader or nearest[0]
    helpers = [name for name in nearest if name != leader]
    if lacking(planner, helpers):
        needed = sorted(planner.required) or [f"{planner.helpers + 1} robots"]
        raise MissionFailed(f"{' and '.join(needed)} are needed; free are {', '.join(sorted(free))}")
    candidates = [leader, *helpers[: planner.helpers + DEFAULT_POLICY.spare_candidates]]
    try:
        plan = planner.plan("party", leader, {name: free[name] for name in candidates})
    except InTheWay as blocked:
        return candidates[: planner.helpers + 1], sorted(blocked.aside)
    return sorted((subplan.robot for subplan in plan.subplans), key=lambda name: (name != leader, name)), []


def nearest_first(planner: CooperativePlanner, free: Mapping[str, Place], refusing: Collection[str] = ()) -> list[str]:
    """Free robots: first those that are required, then those that did not refuse, by their distance."""
    here = planner.meeting_point

    def rank(name: str) -> tuple[bool, bool, bool, float]:
        at = free[name]
        return name not in planner.required, name in refusing, at.floor != here.floor, math.dist(at[1:], here[1:])

    return sorted(free, key=rank)


def lacking(
    planner: CooperativePlanner, robots: Collection[str], busy: Mapping[str, str] = MappingProxyType({})
) -> str:
    """Why these helpers are not sufficient, empty if they are."""
    others = "".join(f"; {name} {does}" for name, does in busy.items())
    if len(robots) < planner.helpers:
        return (
            f"{planner.helpers} helpers are needed; {', '.join(sorted(robots)) or 'no robot'} offered to help{others}"
        )
    if absent := sorted(planner.required.difference(robots)):
        return f"{' and '.join(absent)} did not offer to help: not there, or not free{others}"
    return ""
