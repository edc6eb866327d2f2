"""Carries with one fault each, at a random moment.

    python -m bench.missions.faults --missions 25 [--site SITE] [--fault FAULT] [--phase PHASE]

Robots of two sub-networks carry something to and fro at a site; free robots are nearby. Faults: `robots` are killed,
the leader or a member; a robot `hangs` for 8 s; one gets an emergency stop (`stops`); `servers` or a channel are
killed; something is in the way or at the goal (`ways`, at the site `hall`); the link between the sub-networks is `cut`
for 2 to 30 s (root); `nothing`. `all` mixes them but for `ways` and `cut`. The first mission has no fault and shows how
long a carry takes. Without --site it is the hall for `ways`, the door for `cut`, else the rooms.

Each mission must be done with the object at its goal, or end safely with a reason. No robot may obey two leaders,
nothing may be torn from a hand or touch anything, robots must stand soon after their leader is silent, and one that was
stopped until it is reset, after the mission. While the networks are apart at most one side may move."""

from __future__ import annotations

import contextlib
import math
import random
import re
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from functools import partial
from typing import Any, NamedTuple

from bench.common.harness import folder_of_bench, progress, run
from bench.missions.in_the_way import CASES, Obstacles
from bench.missions.network import TwoNetworks, two_networks
from bench.missions.sites import SITES, Site
from bench.missions.witness import Witness
from robocorba.errors.base import RoboCorbaError
from robocorba.simulation.corba.remote_database import RemoteDatabase
from robocorba.simulation.mission_record import MissionContent, MissionState
from robocorba.simulation.registry import Pose
from testkit.faults import WAYS, hang_for, stop_robot
from testkit.json_process import ProcessFailed
from testkit.missions import MissionSystem, RobotStart
from testkit.missions import missions as mission_system
from testkit.processes import eventually
from testkit.report import Mark, at_least, at_most, quantile, summarize

SERVERS = ("simulation", "map_editor", "omniNames", "events_lab", "events_hall")
#: Least shares of the missions that are done with a fault; a robot that stands, and what is in the way, may stay there.
DONE = {"robots": 0.95, "hangs": 0.95, "servers": 0.96, "cut": 0.9, "nothing": 1.0}
FAULTS = (*DONE, "stops", "ways", "all")
#: How often each fault is among those of `all`.
ALL = ("robots",) * 9 + ("servers",) * 5 + ("hangs",) * 2 + ("stops",) * 2
#: Faults that missions survive: of these the share that is done is a mark of `all`.
SURVIVED, SURVIVING = ("robots", "servers", "hangs"), 0.95
#: Time limit of a mission [s], and from a fault of `all` that is survived to the end: members time out after 4 s, have
#: 25 s for a safe end, find others within 60 s, and begin again.
LIMIT_S, DEADLINE_S = 600.0, 180.0
#: Largest distance of the object from its goal [m].
NEAR_M = 0.01
#: Duration of a hang [s], longer than every timeout of a mission's messages, and of a cut [s].
HANG_S, CUT_S = 8.0, (2.0, 30.0)
#: Time after which a robot that was stopped stands, and one that lost its leader or the simulation server [s].
STOPPED_S, LOST_S = 1.0, 1.5
#: Time for which robots may drive after the kill of their leader [s]: carriers stand 0.4 s after its last order, and
#: the witness looks every 0.04 s.
DROVE_ON_S = 0.5
#: Time limits for robots to be free after a mission, and for those that were killed to be logged off [s].
FREE_LIMIT_S, GONE_LIMIT_S = 120.0, 20.0
#: One-way delay of the link that is cut [ms].
DELAY_MS = 1.0


#: What happened to a mission that had ended before its fault: if it was done, that says nothing about the fault.
TOO_LATE = "too late"


class Struck(NamedTuple):
    """A fault that happened. began, over: its time [s]. reason: a pattern of the reasons for which the mission may end.
    to_stand: the robots that have to stand. sides: of the networks that moved while they were apart."""

    what: str
    began: float
    over: float
    reason: str = "."
    to_stand: tuple[str, ...] = ()
    sides: Collection[str] = ()


class Outcome(NamedTuple):
    """The outcome of a mission. at_s: of the fault, after the command. end_s: from the end of the fault to the end of
    the mission. off_m: of the object from its goal. attempts: that it took."""

    fault: str
    what: str
    at_s: float
    result: str
    reason: str
    end_s: float
    off_m: float
    drove_on_s: float
    attempts: int
    wrong: tuple[str, ...]


class Trials:
    """Successive missions at one site. both: the networks whose link is cut."""

    def __init__(self, place: MissionSystem, site: Site, phase: str, seed: int, both: TwoNetworks | None) -> None:
        self._place, self._site, self._phase, self._both = place, site, phase, both
        self._random, self._database = random.Random(seed), RemoteDatabase(place.orb, 5.0)
        self._members: dict[str, RobotStart] = {}
        self._started = 0
        self._took_s: list[float] = []
        self._restore()
        last = site.starts[-1]
        self._other = next(name for name, at in self._members.items() if (at.x, at.y) == (last.x, last.y))
        self._obstacles = Obstacles(place, self._random, self._other)
        self._strikes: dict[str, Callable[[], Struck]] = {
            "robots": self._kill_robot,
            "hangs": self._hang_robot,
            "stops": self._stop_robot,
            "servers": self._kill_server,
            "cut": self._cut,
        }

    def mission(self, fault: str, deadline_s: float = math.inf) -> Outcome:
        """One that cannot even begin, because of what an earlier one has left behind, has failed."""
        try:
            return self._mission(fault, deadline_s)
        except (AssertionError, ProcessFailed, RoboCorbaError) as error:
            why = f"broke off: {str(error)[:300]}"
            return Outcome(fault, "broke off", 0.0, "error", why, math.inf, math.inf, 0.0, 0, (why,))

    def _mission(self, fault: str, deadline_s: float) -> Outcome:
        self._restore()
        at = self._at()
        goal = max(self._site.goals, key=lambda each: (each.floor != at.floor, math.dist(each[1:3], at[1:3])))
        wrong: list[str] = []
        with Witness(self._place) as witness, contextlib.ExitStack() as stack:
            case = self._random.choice(CASES) if fault == "ways" else ""
            if "before" in case:
                self._obstacles.put(stack, case, at, goal)
            began = time.monotonic()
            leader = self._random.choice([name for name in self._members if not (case and name == self._other)])
            user = self._place.mission(leader, self._site.item, f"{goal.floor}:{goal.x},{goal.y},{goal.heading}")
            try:
                struck = self._strike(fault, case, leader, user, goal, stack, witness)
            except AssertionError as late:
                struck = Struck("not reached", began, time.monotonic())
                wrong.append(f"did not reach its fault: {str(late)[:300]}")
            result, reason = self._place.result(user, LIMIT_S)
            ended = time.monotonic()
            stack.close()
            wrong += self._left_behind()
        off_m = math.dist(self._at()[1:3], goal[1:3]) if self._at().floor == goal.floor else math.inf
        wrong += self._errors(fault, result, reason, off_m, struck, witness, ended)
        if ended - struck.over > deadline_s:
            wrong.append(f"ended {ended - struck.over:.0f} s after the fault")
        drove_on_s = witness.drove_on_s(struck.to_stand, struck.over) if fault == "robots" else 0.0
        if fault == "nothing":
            self._took_s.append(ended - began)
        if case:
            self._obstacles.restore()
        last = self._last_mission()
        attempts = MissionContent.decode(self._database.mission(last.name).document).attempts if last else 0
        return Outcome(
            *(fault, struck.what, struck.began - began, result, reason, ended - struck.over),
            *(off_m, drove_on_s, attempts, tuple(wrong)),
        )

    # ---- faults ----

    def _strike(
        self,
        fault: str,
        case: str,
        leader: str,
        user: subprocess.Popen[str],
        goal: Pose,
        stack: contextlib.ExitStack,
        witness: Witness,
    ) -> Struck:
        """Wait for the moment of a fault and cause it."""
        now = time.monotonic()
        if case:
            if "before" not in case:
                self._place.carrying(leader, self._site.item, user, self._random.uniform(0.3, 3.0))
                self._obstacles.put(stack, case, self._at(), goal)
            now = time.monotonic()
            return Struck(case, now, now, "|".join(self._obstacles.names(case)))
        if fault == "nothing":
            return Struck(fault, now, now)
        longest_s = statistics.median(self._took_s or [LIMIT_S])
        if self._phase:  # a plan need not have it, such as one that begins where another mission has left the object
            longest_s = 5.0
            eventually(lambda: user.poll() is not None or self._place.has_begun(leader, self._phase), LIMIT_S)
        else:  # a leader that is gone before it has begun can only be reported
            eventually(lambda: self._running()[0] or user.poll() is not None, LIMIT_S, "a mission")
        with contextlib.suppress(subprocess.TimeoutExpired):
            user.wait(self._random.uniform(0.0, longest_s))
        if user.poll() is not None:
            return Struck(TOO_LATE, now, time.monotonic())
        struck = self._strikes[fault]()
        if fault == "cut":
            moved = witness.drivers(struck.began + LOST_S, struck.over)
            struck = struck._replace(sides={at.channel for name, at in self._members.items() if name in moved})
        return struck

    def _kill_robot(self) -> Struck:
        role, victim, team = self._victim()
        began = time.monotonic()
        self._members.pop(victim)
        process = self._place.robots.pop(victim)
        process.kill()
        process.communicate()
        others = tuple(name for name in team if name != victim) if role == "leader" else ()
        reason = rf"\b{victim}\b|not reachable|not answer|helpers are needed|silent"
        return Struck(f"{role} killed", began, time.monotonic(), reason, others)

    def _hang_robot(self) -> Struck:
        role, victim, _ = self._victim()
        began = time.monotonic()
        hang_for(HANG_S, self._place.robots[victim].pid)
        return Struck(f"{role} hangs", began, time.monotonic(), rf"\b{victim}\b|not answer|silent")

    def _stop_robot(self) -> Struck:
        role, victim, _ = self._victim()
        began, way = time.monotonic(), self._random.choice(WAYS)
        stop_robot(self._place.running, self._place.orb, victim, way)
        return Struck(f"{role} stopped by {way}", began, time.monotonic(), rf"\b{victim}\b|emergency stop", (victim,))

    def _kill_server(self) -> Struck:
        server, began = self._random.choice(SERVERS), time.monotonic()
        self._place.kill_server(server)
        return Struck(f"{server} killed", began, began)

    def _cut(self) -> Struck:
        assert self._both is not None
        self._both.cut()
        began = time.monotonic()
        time.sleep(self._random.uniform(*CUT_S))
        self._both.cut(False)
        return Struck("link cut", began, time.monotonic())

    def _victim(self) -> tuple[str, str, tuple[str, ...]]:
        """A role in the running mission, who has it, and the team."""
        leader, team = self._running()
        members = [name for name in team or self._members if name != leader]
        role = self._random.choice(("leader", "member")) if leader else "member"
        return role, leader if role == "leader" else self._random.choice(members), team

    # ---- robots ----

    def _restore(self) -> None:
        """Start robots in place of those that are gone, far from all others, so that each sub-network has some."""
        starts = self._site.starts
        while len(self._members) < len(starts):
            missing = {at.channel for at in starts} - {at.channel for at in self._members.values()}
            start = max(starts, key=partial(_gap_m, list(self._place.poses().values())))
            start = start._replace(channel=min(missing)) if missing else start
            if self._both and start.channel == "hall":
                start = start._replace(within=self._both.within)
            self._started += 1
            name = f"r{self._started}"
            self._members[name] = start
            self._place.start({name: start})

    def _left_behind(self) -> list[str]:
        """Errors in the state of robots and object after a mission."""
        wrong = self._place.left_behind(list(self._members), [self._site.item], FREE_LIMIT_S)
        try:
            eventually(lambda: self._place.names() == self._members.keys(), GONE_LIMIT_S)
        except AssertionError:
            wrong.append(f"logged on: {self._place.names()}, expected: {list(self._members)}")
        return wrong

    # ---- what came of it ----

    def _errors(
        self,
        fault: str,
        result: str,
        reason: str,
        off_m: float,
        struck: Struck,
        witness: Witness,
        ended: float,
    ) -> Iterator[str]:
        if result != "done" and fault == "nothing":
            yield f"without a fault: {reason}"
        if result == "done" and off_m > NEAR_M:
            yield f"the {self._site.item} is {1000 * off_m:.0f} mm from its goal"
        if result != "done" and not re.search(struck.reason, reason):
            yield f"the reason does not match {struck.reason}: {reason!r}"
        yield from witness.disobedience()
        yield from witness.blindness() if result == "done" else ()
        yield from (f"touched: {each}" for each in dict.fromkeys(witness.touched))
        yield from (f"grip lost: {each}" for each in dict.fromkeys(witness.grips_lost))
        if len(struck.sides) > 1:
            yield "both sides moved"
        if fault == "stops":
            drivers = witness.drivers(struck.over + STOPPED_S, ended)
            yield from (f"{name} drove after its stop" for name in struck.to_stand if name in drivers)
        if fault == "cut":
            last = self._last_mission()
            if last is None or last.content.result.value != result:
                yield f"the record says {last and last.content.result.value}, its user {result}"
            running = [state.name for state in self._place.missions_since(0) if state.content.is_running]
            yield from (f"{name} is still recorded as running" for name in running)

    def _at(self) -> Pose:
        return self._place.poses()[self._site.item]

    def _running(self) -> tuple[str, tuple[str, ...]]:
        """Leader and team of the running mission; empty if nobody says."""
        for content in (state.content for state in self._place.missions_since(0)):
            if content.is_running:
                return content.leader, tuple(member.robot for member in content.members)
        return "", ()

    def _last_mission(self) -> MissionState | None:
        return max(self._place.missions_since(0), key=lambda state: state.content.begun, default=None)


def _gap_m(poses: Sequence[Pose], start: RobotStart) -> float:
    """Distance of a start pose from the nearest of `poses` [m]."""
    near = (math.dist((start.x, start.y), at[1:3]) for at in poses if at.floor == start.floor)
    return min(near, default=math.inf)


# ---- the bench ----


@contextlib.contextmanager
def trials(name: str, fault: str, phase: str, seed: int) -> Iterator[Trials]:
    """At a site, in one network or in two."""
    site = SITES[name]()
    with folder_of_bench() as folder, contextlib.ExitStack() as stack:
        both = stack.enter_context(two_networks(folder, DELAY_MS, site.building)) if fault == "cut" else None
        place = both.place if both else stack.enter_context(mission_system(folder, site.building))
        yield Trials(place, site, phase, seed, both)


def faults_of(fault: str, missions: int, seed: int) -> list[str]:
    """A mission without a fault, then those of `all` in random order, or the same one."""
    chance, found = random.Random(seed), ["nothing"]
    while len(found) <= missions:
        found += chance.sample(ALL, len(ALL)) if fault == "all" else [fault]
    return found[: missions + 1]


def row(what: str, outcomes: Sequence[Outcome]) -> dict[str, Any]:
    return {
        "fault": what,
        "missions": len(outcomes),
        "done": sum(one.result == "done" for one in outcomes),
        "ended safely": sum(one.result != "done" and not one.wrong for one in outcomes),
        "wrong": sum(bool(one.wrong) for one in outcomes),
        "attempts": statistics.mean(one.attempts for one in outcomes),
        "s to the end": quantile([one.end_s for one in outcomes], 0.5),
        "most": max(one.end_s for one in outcomes),
        "mm off": max((1000 * one.off_m for one in outcomes if one.result == "done"), default=None),
        "drove on, s": max(one.drove_on_s for one in outcomes),
    }


def judged_of(fault: str, outcomes: Sequence[Outcome]) -> list[Outcome]:
    """The missions by which a fault is judged. Whatever was not done is among them, also what failed because of what an
    earlier mission had left behind."""
    faults = SURVIVED if fault == "all" else (fault,)
    return [one for one in outcomes if one.fault in faults and (one.what != TOO_LATE or one.result != "done")]


def marks_of(fault: str, outcomes: Sequence[Outcome]) -> list[Mark]:
    touched = sum(any(each.startswith("touched") for each in one.wrong) for one in outcomes)
    judged = judged_of(fault, outcomes)
    least = SURVIVING if fault == "all" else DONE.get(fault)
    marks = [
        at_most("missions with errors", sum(bool(one.wrong) for one in outcomes), 0),
        at_most("missions in which something touched something", touched, 0),
        at_most("drove on after the kill of the leader, s", max(one.drove_on_s for one in outcomes), DROVE_ON_S),
    ]
    if least is not None and judged:
        share = sum(one.result == "done" for one in judged) / len(judged)
        marks.append(at_least(f"share of the missions that are done with the fault {fault}", share, least))
    return marks


def main(missions: int = 13, seed: int = 1, site: str = "", fault: str = "all", phase: str = "") -> bool:
    site = site or {"ways": "hall", "cut": "door"}.get(fault, "rooms")
    if fault == "ways" and site != "hall":
        sys.exit("faults: ways needs the site hall")
    every: list[Outcome] = []
    with trials(site, fault, phase, seed) as found:
        for each in progress(faults_of(fault, missions, seed), site):
            one = found.mission(each, DEADLINE_S if fault == "all" and each in SURVIVED else math.inf)
            every.append(one)
            when = f"at {one.at_s:.1f} s\tended {one.end_s:.1f} s later\t{one.attempts} attempts"
            print(one.what, when, one.result, one.reason, *one.wrong, sep="\t", flush=True)
    rows = [row(what, [one for one in every if one.what == what]) for what in dict.fromkeys(one.what for one in every)]
    rows += [row("judged", judged) for judged in (judged_of(fault, every),) if judged]
    title, missions_told = f"carries at {site}, with the fault {fault}", [one._asdict() for one in every]
    return summarize("mission_faults", title, rows, marks_of(fault, every), missions=missions_told)


if __name__ == "__main__":
    run(
        main,
        missions="with a fault",
        seed="of faults and moments",
        site="|".join(("", *SITES)),
        fault="|".join(FAULTS),
        phase="of the mission in which it happens, instead of at any time",
    )
