"""Carries with a kill -9, or an emergency stop of one robot, at a random moment.

    python -m bench.missions.survival --missions 25 [--site SITE] [--kill robots|servers|stops|nothing] [--phase PHASE]

Robots of two sub-networks carry something to and fro at a site: in rooms, through a door, over floors by an elevator,
or all of it in a workshop. In each mission the leader or a member is killed, or a server or a channel, at a random
moment of the time that a carry takes; free robots are nearby. Each mission must be done with the
object at its goal, or end safely with a reason. No robot may obey two leaders, nothing may be torn from a hand or
touch anything, and robots must stand soon after their leader is silent. A robot that was stopped must not drive before
it is reset, which is after the mission."""

from __future__ import annotations

import contextlib
import math
import random
import statistics
import subprocess
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from matplotlib.axes import Axes
from omniORB import CORBA

from bench.common.harness import progress, run
from bench.missions.crew import Crew
from bench.missions.sites import SITES, Site
from bench.missions.witness import Witness
from robocorba.errors.base import RoboCorbaError
from robocorba.errors.services import NotReachable
from robocorba.map_editor import native
from robocorba.simulation.corba.remote_database import RemoteDatabase
from robocorba.simulation.mission_record import MissionContent
from robocorba.stubs import RoboCorba
from testkit.missions import MissionSystem
from testkit.missions import missions as mission_system
from testkit.processes import ROBOCORBA, eventually
from testkit.report import at_least, at_most, quantile, summarize

SERVERS = ("simulation", "map_editor", "omniNames", "events_lab", "events_hall")
#: Time limit of a mission [s].
LIMIT_S = 400.0
#: Largest distance of the object from its goal [m].
NEAR_M = 0.01
#: Least shares of the missions that are done with a kill of a robot and of a server.
DONE = {"robots": 0.95, "servers": 0.96, "nothing": 1.0}
#: What is done to whom; "stops" without a mark, since a robot that stands may be in the way of every other carry.
KILLS = (*DONE, "stops")
#: Time limit for an emergency stop to be confirmed, and after that for a body to stand [s].
STOP_LIMIT_S, GRACE_S = 60.0, 1.0
#: Time for which robots may drive after the kill of their leader [s]: carriers stand 0.4 s after its last order, and
#: the witness looks every 0.04 s.
DROVE_ON_S = 0.5


class Outcome(NamedTuple):
    """The outcome of a mission. killed: leader, member, the name of a server, or the way of a stop. at_s: after the
    command. phase: of the mission at the kill. end_s: from the kill to the end. off_m: of the object from its goal.
    drove_on_s: of robots whose leader was killed, or which were stopped. attempts: that it took."""

    killed: str
    at_s: float
    phase: str
    result: str
    reason: str
    end_s: float
    off_m: float
    drove_on_s: float
    attempts: int
    wrong: tuple[str, ...]


class Survival:
    """Successive missions at one site."""

    def __init__(self, place: MissionSystem, site: Site, kill: str, phase: str, seed: int) -> None:
        self.place, self.site, self._kill, self._phase, self._random = place, site, kill, phase, random.Random(seed)
        self._crew = Crew(place, site.starts, site.item)
        self._database = RemoteDatabase(place.orb, 5.0)
        #: Duration of the missions without a kill [s].
        self._took_s: list[float] = []

    def mission(self, kill: bool) -> Outcome:
        """Run a mission, with a kill or without."""
        self._crew.restore()
        at = self.place.poses()[self.site.item]
        goal = max(self.site.goals, key=lambda each: (each.floor != at.floor, math.dist(each[1:3], at[1:3])))
        began = time.monotonic()
        killed, killed_at, phase = "", began, ""
        to_stand: tuple[str, ...] = ()
        with Witness(self.place) as witness:
            leader = self._random.choice(list(self._crew.members))
            user = self.place.mission(leader, self.site.item, f"{goal.floor}:{goal.x},{goal.y},{goal.heading}")
            if kill and self._phase:
                # A plan need not have this phase, such as one that begins where another mission has left the object.
                eventually(
                    lambda: user.poll() is not None or self.place.has_begun(leader, self._phase), LIMIT_S, self._phase
                )
                with contextlib.suppress(subprocess.TimeoutExpired):
                    user.wait(self._random.uniform(0.0, 5.0))
            elif kill:
                # A leader that is gone before it has begun can only be reported.
                eventually(lambda: self._running()[0] or user.poll() is not None, LIMIT_S, "a mission")
                with contextlib.suppress(subprocess.TimeoutExpired):
                    user.wait(self._random.uniform(0.0, statistics.median(self._took_s)))
            if kill and user.poll() is None:
                killed, phase, to_stand = self._strike()
                killed_at = time.monotonic()
            result, rest = self.place.result(user, LIMIT_S)
            ended = time.monotonic()
            wrong = self._crew.aftermath()
        at = self.place.poses()[self.site.item]
        off_m = math.dist(at[1:3], goal[1:3]) if at.floor == goal.floor else math.inf
        if result == "done" and off_m > NEAR_M:
            wrong.append(f"the {self.site.item} is {1000 * off_m:.0f} mm from its goal")
        wrong += witness.disobedience()
        if result == "done":
            wrong += witness.blindness()
        wrong += [f"touched: {each}" for each in dict.fromkeys(witness.touched)]
        wrong += [f"grip lost: {each}" for each in dict.fromkeys(witness.grips_lost)]
        drove_on_s = witness.drove_on_s(to_stand, killed_at)
        if self._kill == "stops":
            drivers = witness.drivers(killed_at + GRACE_S, ended)
            wrong += [f"{name} drove after its stop" for name in to_stand if name in drivers]
        if not killed:
            self._took_s.append(ended - began)
        return Outcome(
            killed or "nothing",
            killed_at - began,
            phase,
            result,
            rest,
            ended - killed_at,
            off_m,
            drove_on_s,
            self._attempts(),
            tuple(wrong),
        )

    def _strike(self) -> tuple[str, str, tuple[str, ...]]:
        """Kill a robot or a server, or stop a robot. Returns which one or how, the mission's phase, and the robots that
        have to stand after it."""
        if self._kill == "servers":
            server = self._random.choice(SERVERS)
            phase = self._running()[1]
            self.place.kill_server(server)
            return server, phase, ()
        leader, phase, team = self._running()
        members = [name for name in team or self._crew.members if name != leader]
        if self._kill == "stops":
            victim = self._random.choice([*members, leader] if leader else members)
            return f"{self._stop(victim)} stops the {'leader' if victim == leader else 'member'}", phase, (victim,)
        role = self._random.choice(("leader", "member")) if leader else "member"
        victim = leader if role == "leader" else self._random.choice(members)
        self._crew.kill(victim)
        return role, phase, tuple(name for name in team if name != victim) if role == "leader" else ()

    def _stop(self, victim: str) -> str:
        """Stop a robot in one of three ways, again until that is confirmed; returns which."""
        running = self.place.running
        command = (ROBOCORBA, "stop", victim, "--naming", str(running.naming), "--state", str(running.state))

        def by_server() -> None:
            self.place.orb.resolve("SimulationServer", RoboCorba.SimulationServer).stopRobots([victim], "bench")

        ways: dict[str, Callable[[], object]] = {
            "the command": lambda: subprocess.run(command, check=True, capture_output=True, timeout=STOP_LIMIT_S),
            "the server": by_server,
            "the agent": lambda: self.place.agent(victim).stop(),
        }
        way = self._random.choice(list(ways))
        eventually(lambda: is_confirmed(ways[way]), STOP_LIMIT_S, f"a stop by {way}")
        return way

    def _running(self) -> tuple[str, str, tuple[str, ...]]:
        """Leader, phase and team of the running mission; empty if nobody says."""
        with contextlib.suppress(NotReachable):
            for state in self.place.control.missions_since(0):
                content = state.content
                if content.is_running:
                    phase = content.phases[-1].name if content.phases else ""
                    return content.leader, phase, tuple(member.robot for member in content.members)
        return "", "", ()

    def _attempts(self) -> int:
        """Number of attempts at the last mission, by its record."""
        states = self.place.missions_since(0)
        if not states:
            return 0
        last = max(states, key=lambda state: state.content.begun)
        return MissionContent.decode(self._database.mission(last.name).document).attempts


def is_confirmed(stop: Callable[[], object]) -> bool:
    """Whether a stop was made without an error."""
    try:
        stop()
    except (RoboCorbaError, CORBA.SystemException, subprocess.SubprocessError):
        return False
    return True


def row(what: str, outcomes: Sequence[Outcome]) -> dict[str, Any]:
    done = [one for one in outcomes if one.result == "done"]
    return {
        "killed": what,
        "missions": len(outcomes),
        "done": len(done),
        "ended safely": sum(one.result != "done" and not one.wrong for one in outcomes),
        "wrong": sum(bool(one.wrong) for one in outcomes),
        "attempts": statistics.mean(one.attempts for one in outcomes),
        "s to the end": quantile([one.end_s for one in outcomes], 0.5),
        "most": max(one.end_s for one in outcomes),
        "mm off": max((1000 * one.off_m for one in done), default=math.nan),
        "drove on, s": max(one.drove_on_s for one in outcomes),
    }


def main(missions: int = 25, seed: int = 1, site: str = "rooms", kill: str = "robots", phase: str = "") -> bool:
    outcomes: list[Outcome] = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        native.save(SITES[site].building(), folder / "site.yaml")
        with mission_system(folder, folder / "site.yaml") as place:
            survival = Survival(place, SITES[site], kill, phase, seed)
            for number in progress(range(missions + 1), "missions"):
                one = survival.mission(kill != "nothing" and number > 0)  # the first one measures a carry
                outcomes.append(one)
                when = f"at {one.at_s:.1f} s ({one.phase})\tended {one.end_s:.1f} s later"
                measured = f"{one.attempts} attempts\tdrove on {one.drove_on_s:.2f} s"
                print(number, one.killed, when, measured, one.result, one.reason, one.wrong, sep="\t", flush=True)
    killed = [one for one in outcomes if one.killed != "nothing"] or outcomes
    done = sum(one.result == "done" for one in killed) / len(killed)
    marks = [
        at_most("missions with errors", sum(bool(one.wrong) for one in outcomes), 0),
        at_most("drove on after the kill of the leader, s", max(one.drove_on_s for one in outcomes), DROVE_ON_S),
    ]
    if kill in DONE:
        marks.append(at_least(f"share of the missions that are done with a kill of {kill}", done, DONE[kill]))
    by_kind = {what: [one for one in outcomes if one.killed == what] for what in sorted({o.killed for o in outcomes})}

    def draw(axes: Axes) -> None:
        for what, found in by_kind.items():
            axes.plot([one.at_s for one in found], [one.end_s for one in found], "o", label=what)
        axes.set(xlabel="s from the command to the kill", ylabel="s from the kill to the end")
        axes.legend()

    title = f"{len(outcomes)} carries at the site {site}, with a kill of {kill}"
    return summarize(f"mission_survival_{site}", title, [row(*each) for each in by_kind.items()], marks, draw)


if __name__ == "__main__":
    run(
        main,
        seed="of kills and moments",
        site="|".join(SITES),
        kill="|".join(KILLS),
        phase="of the mission in which they are killed, instead of at any time",
    )
