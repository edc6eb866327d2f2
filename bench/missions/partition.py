"""Carries during which the link between two sub-networks is cut for a while.

    python -m bench.missions.partition --rounds 20

All servers, the channel of lab and two robots are in one network namespace, the channel of hall and two other robots in
another, with a router process between them. Robots carry a box through a door to and fro; in each round the router
drops all packets for 2 to 30 s, at a random moment of the time that a carry takes. The mission must be done, or end
safely with a reason; while the networks are apart at most one side may move, and afterwards the mission's record, its
user and all robots must agree that it has ended. It must run as root; without network namespaces it prints so and
measures nothing."""

from __future__ import annotations

import contextlib
import math
import random
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from matplotlib.axes import Axes

from bench.common.harness import NotMeasured, progress, run
from bench.missions.crew import Crew
from bench.missions.network import TwoNetworks, two_networks
from bench.missions.sites import SITES
from bench.missions.witness import Witness
from robocorba.map_editor import native
from testkit.report import at_least, at_most, quantile, summarize

NAME = "missions_partition"
SITE = SITES["door"]
#: One-way delay of the link [ms].
DELAY_MS = 1.0
#: Shortest and longest cut [s].
CUT_S = (2.0, 30.0)
#: Robots that have lost their leader, or the simulation server, stand after this time [s].
STAND_S = 1.5
#: Time limit of a mission [s].
LIMIT_S = 400.0
#: Looks at what a round has left behind, until all is well.
LOOKS = 4
#: Largest distance of the object from its goal [m].
NEAR_M = 0.01


class Round(NamedTuple):
    """The outcome of a round. at_s: of the cut, after the command. end_s: from healing to the end. sides: of the
    networks that moved while they were apart."""

    leader: str
    at_s: float
    cut_s: float
    result: str
    reason: str
    end_s: float
    off_m: float
    sides: tuple[str, ...]
    wrong: tuple[str, ...]


class Partitions:
    """Successive rounds with the same robots."""

    def __init__(self, both: TwoNetworks, seed: int) -> None:
        self._both, self.place, self._random = both, both.place, random.Random(seed)
        starts = [at._replace(within=both.within) if at.channel == "hall" else at for at in SITE.starts]
        self._crew = Crew(both.place, starts, SITE.item)
        #: Duration of the mission without a cut [s].
        self._took_s = 0.0

    def round(self, cut: bool) -> Round:
        """Run a mission, with a cut or without."""
        at = self.place.poses()[SITE.item]
        goal = max(SITE.goals, key=lambda each: math.dist(each[1:3], at[1:3]))
        side_of = {name: start.channel for name, start in self._crew.members.items()}
        leader = self._random.choice(sorted(side_of))
        sides: set[str] = set()
        with Witness(self.place) as witness:
            began = time.monotonic()
            user = self.place.mission(leader, SITE.item, f"{goal.floor}:{goal.x},{goal.y},{goal.heading}")
            cut_at = healed_at = began
            if cut:
                time.sleep(self._random.uniform(1.0, self._took_s))
                self._both.cut()
                cut_at = time.monotonic()
                time.sleep(self._random.uniform(*CUT_S))
                self._both.cut(False)
                healed_at = time.monotonic()
                moved = witness.drivers(cut_at + STAND_S, healed_at)
                sides = {side_of[name] for name in moved & side_of.keys()}
            result, reason = self.place.result(user, LIMIT_S)
            ended = time.monotonic()
            wrong = self._aftermath()
        wrong += self._disagreement(result)
        at = self.place.poses()[SITE.item]
        off_m = math.dist(at[1:3], goal[1:3])
        if result == "done" and off_m > NEAR_M:
            wrong.append(f"the {SITE.item} is {1000 * off_m:.0f} mm from its goal")
        if len(sides) > 1:
            wrong.append("both sides moved")
        wrong += witness.disobedience()
        wrong += [f"touched: {each}" for each in dict.fromkeys(witness.touched)]
        if not cut:
            self._took_s = ended - began
        return Round(
            f"{leader} of {side_of[leader]}",
            cut_at - began,
            healed_at - cut_at,
            result,
            reason,
            ended - healed_at,
            off_m,
            tuple(sorted(sides)),
            tuple(wrong),
        )

    def _aftermath(self) -> list[str]:
        """Errors that are left once robots have noticed that the networks are joined again."""
        wrong: list[str] = []
        for _ in range(LOOKS):
            wrong = self._crew.aftermath()
            if not wrong:
                break
        return wrong

    def _disagreement(self, result: str) -> list[str]:
        """Whether the records of the missions and the user disagree on the last one's result."""
        wrong: list[str] = []
        states = self.place.missions_since(0)
        last = max(states, key=lambda state: state.content.begun)
        if last.content.result.value != result:
            wrong.append(f"the record of {last.name} says {last.content.result.value}, its user {result}")
        if running := [state.name for state in states if state.content.is_running]:
            wrong.append(f"still recorded as running: {running}")
        return wrong


def row(what: str, rounds: Sequence[Round]) -> dict[str, Any]:
    done = [one for one in rounds if one.result == "done"]
    return {
        "link": what,
        "missions": len(rounds),
        "done": len(done),
        "ended safely": sum(one.result != "done" and not one.wrong for one in rounds),
        "wrong": sum(bool(one.wrong) for one in rounds),
        "s from healing to the end": quantile([one.end_s for one in rounds], 0.5),
        "most": max(one.end_s for one in rounds),
        "mm off": max((1000 * one.off_m for one in done), default=math.nan),
        "both moved": sum(len(one.sides) > 1 for one in rounds),
    }


def main(rounds: int = 20, seed: int = 1) -> bool:
    """Raises NotMeasured without network namespaces."""
    found: list[Round] = []
    with tempfile.TemporaryDirectory() as temporary, contextlib.ExitStack() as stack:
        folder = Path(temporary)
        native.save(SITE.building(), folder / "site.yaml")
        try:
            both = stack.enter_context(two_networks(folder, DELAY_MS, folder / "site.yaml"))
        except OSError as error:
            raise NotMeasured(f"network namespaces are not available ({error}); run it as root") from None
        partitions = Partitions(both, seed)
        for number in progress(range(rounds + 1), "rounds"):
            one = partitions.round(number > 0)  # the first one measures a carry
            found.append(one)
            when = f"cut after {one.at_s:.1f} s for {one.cut_s:.1f} s\tended {one.end_s:.1f} s later"
            print(number, one.leader, when, one.sides, one.result, one.reason, one.wrong, sep="\t", flush=True)
    cut = found[1:]
    marks = [
        at_least("share of the missions that are done", sum(one.result == "done" for one in cut) / len(cut), 0.9),
        at_most("missions with errors", sum(bool(one.wrong) for one in found), 0),
    ]

    def draw(axes: Axes) -> None:
        axes.plot([one.cut_s for one in cut], [one.end_s for one in cut], "o")
        axes.set(xlabel="s that the link is cut", ylabel="s from healing to the end of the mission")

    rows = [row("never cut", found[:1]), row("cut", cut)]
    return summarize(NAME, f"{len(cut)} carries with a cut between the sub-networks", rows, marks, draw)


if __name__ == "__main__":
    run(main, seed="of leaders, moments and cuts")
