"""All attacks at random beside robots, missions and clients that do nothing wrong.

    python -m bench.chaos.attacks [--minutes 30] [--drivers 20] [--at-once 2] [--seed 1] [--only KIND] [--quiet 320]

A plain system on loopback: everybody may call everything. Twenty robots drive by paths of the planner, two missions
carry tables to and fro again and again, and a client calls all servers, sends numbered events from one sub-network to
the other, and resolves names. Meanwhile `at-once` clients attack, each in one of the ways of bench.chaos.attackers for
5 to 20 s; then they are killed and others begin. Attackers have a lower priority of the CPU, as if they were on other
machines. Afterwards everybody must have got what they asked for, and each server must need as many threads and
descriptors as before, and as much memory as after a third of the attacks: allocators keep what was once needed at the
same time."""

from __future__ import annotations

import contextlib
import re
import statistics
import time
from collections import Counter, defaultdict
from random import Random
from typing import NamedTuple

import psutil

from bench.chaos.attackers import HERE, KINDS, THERE, Attacker
from bench.chaos.innocents import EVENT, MIDDLES, STOLEN, Carrier, Complaints, Drivers, building, client, starts
from bench.common.harness import folder_of_bench, run
from robocorba.events.blocking_budget import BUDGET_S
from robocorba.stubs import RoboCorba
from testkit.json_process import ObjectProcess, Process, checkout_command
from testkit.missions import MissionSystem
from testkit.missions import missions as mission_system
from testkit.report import PROGRESS, Mark, at_least, at_most, summarize
from testkit.simulation import error_lines

#: The attack by consumers that block suppliers, for BUDGET_S a minute.
BLOCKING = Attacker.absent_consumers.__name__
HELD_UP = f"{EVENT} while consumers block suppliers"
#: Duration of one attack, and time before the first one [s]: servers have what they load at their first calls.
SHORTEST_S, LONGEST_S, SETTLE_S = 5.0, 20.0, 45.0
#: Share of the attacks after which memory is measured that must not grow any more.
FIRST = 1 / 3
#: Time after the first and after the last attacks [s]: a forgotten `pull` ends after 300 s.
QUIET_S = 320.0
#: Longest call or event of those who do nothing wrong [s]. BLOCK_SUPPLIER may hold up events; the owner of a name looks
#: after it every two seconds.
MAX_CALL_S, LIMITS_S = 0.5, {HELD_UP: BUDGET_S + 0.5, STOLEN: 2.0}
#: Private memory that a server may have gained [MB], beside a share of what it had: allocators keep freed memory.
MORE_MB, MORE_SHARE = 30.0, 0.2
#: Threads (of connections that others have just opened) and descriptors that a server may have gained.
MORE_THREADS, MORE_DESCRIPTORS = 8, 16
#: What the simulation server logs of a robot, whose name is the group.
EXPIRED = re.compile(r"(\S+) logged off: its lease of .* expired")


class Needs(NamedTuple):
    """What a process needs. MB: of private memory."""

    pid: int
    mb: float
    threads: int
    descriptors: int

    def is_grown(self, before: Needs, between: Needs) -> bool:
        return (
            self.pid != before.pid
            or self.mb > between.mb * (1 + MORE_SHARE) + MORE_MB
            or self.threads > before.threads + MORE_THREADS
            or self.descriptors > before.descriptors + MORE_DESCRIPTORS
        )


def needs(place: MissionSystem) -> dict[str, Needs]:
    """Of each server."""
    found = {}
    for row in place.running.record().processes:
        with contextlib.suppress(psutil.NoSuchProcess):
            process = psutil.Process(row.pid)
            mb = process.memory_full_info().uss / 1e6
            found[row.name] = Needs(row.pid, mb, process.num_threads(), process.num_fds())
    return found


class Attack(NamedTuple):
    """A running attack."""

    kind: str
    process: Process
    until: float


class Attacks:
    """Attacks at random, `at_once` at a time. longest: of each call, event and theft, by attack [s]."""

    def __init__(self, place: MissionSystem, only: str, at_once: int, seed: int) -> None:
        self._endpoints = [row.endpoint for row in place.running.record().processes if row.endpoint]
        self._place, self._at_once, self._random = place, at_once, Random(seed)
        self._running: list[Attack] = []
        self._blocked_until = 0.0
        self.begun: Counter[str] = Counter(dict.fromkeys([only] if only else KINDS, 0))
        self.longest: dict[str, dict[str, float]] = defaultdict(dict)

    def attack(self, minutes: float, innocent: ObjectProcess, drivers: Drivers, complain: Complaints) -> None:
        """Attack, and note what happens to others."""
        until = time.monotonic() + 60 * minutes
        with PROGRESS.status("attacks") as status:
            while (left_s := until - time.monotonic()) > 0.0:
                self._replace_ended()
                kinds = [each.kind for each in self._running]
                complain.beside = ", ".join(kinds)
                status.update(f"{left_s / 60:.1f} of {minutes:g} minutes left, {complain.beside}")
                time.sleep(1.0)
                drivers.look()
                self.note(kinds, *innocent.call("take"), complain)
        self.close()

    def note(self, kinds: list[str], longest: dict[str, float], wrong: list[str], complain: Complaints) -> None:
        for each in wrong:
            complain.add(each)
        if EVENT in longest and (BLOCKING in kinds or time.monotonic() < self._blocked_until):
            longest[HELD_UP] = longest.pop(EVENT)
        for kind in kinds:
            for what, took_s in longest.items():
                self.longest[kind][what] = max(took_s, self.longest[kind].get(what, 0.0))

    def close(self) -> None:
        for each in self._running[:]:
            self._end(each)

    def _replace_ended(self) -> None:
        """Kill attackers whose time has passed, and start others: those that came least often before."""
        for each in self._running[:]:
            if time.monotonic() > each.until:
                self._end(each)
        while len(self._running) < self._at_once:
            kind = min(self.begun, key=lambda each: (self.begun[each], self._random.random()))
            self.begun[kind] += 1
            arguments = (str(self._place.running.naming), kind, str(self._random.randrange(2**31)), *self._endpoints)
            command = checkout_command("bench.chaos.attackers", *arguments)
            process = Process(command, self._place.folder / "attackers.log")
            until = time.monotonic() + self._random.uniform(SHORTEST_S, LONGEST_S)
            self._running.append(Attack(kind, process, until))

    def _end(self, attack: Attack) -> None:
        with attack.process:
            attack.process.kill()
        if attack.kind == BLOCKING:
            self._blocked_until = time.monotonic() + BUDGET_S
        self._running.remove(attack)


def main(
    minutes: float = 30.0,
    drivers: int = 20,
    at_once: int = 2,
    seed: int = 1,
    only: str = "",
    settle: float = SETTLE_S,
    quiet: float = QUIET_S,
) -> bool:
    complain, found = Complaints(), list[dict[str, Needs]]()
    with folder_of_bench() as folder, contextlib.ExitStack() as stack:
        place = stack.enter_context(mission_system(folder, building(), f"{HERE},{THERE}"))
        place.start(starts(drivers))
        driving = Drivers(place, drivers, complain)
        carriers = [Carrier(place, leader, complain) for leader in MIDDLES]
        for carrier in carriers:
            carrier.start()
        innocent = stack.enter_context(ObjectProcess(client, place.running.naming))
        attacks = stack.enter_context(contextlib.closing(Attacks(place, only, at_once, seed)))
        server = place.orb.resolve("SimulationServer", RoboCorba.SimulationServer, 10.0, 60.0)
        server.renderFloor("L1", 1024)  # what is loaded by the first call belongs to the memory before
        time.sleep(settle)
        innocent.call("take")
        found.append(needs(place))
        for share in (FIRST, 1 - FIRST):
            attacks.attack(share * minutes, innocent, driving, complain)
            for carrier in carriers if share != FIRST else ():
                carrier.end()
            time.sleep(quiet)
            found.append(needs(place))
        attacks.note([], *innocent.call("end"), complain)
        logged = error_lines(place.running.state)
        expired = EXPIRED.findall((place.running.state / "logs" / "simulation.log").read_text())
    before, between, after = found
    for server, then in before.items():
        print(f"{server}: {then}, in between {between.get(server)}, after {after.get(server)}")
    grown = [
        server
        for server, then in before.items()
        if server not in after or after[server].is_grown(then, between.get(server, then))
    ]
    done = [seconds for carrier in carriers for seconds in carrier.done]
    print(*logged[:30], f"{len(done)} missions, {statistics.median(done or [0.0]):.1f} s each", sep="\n")
    rows = [{"attack": kind, "times": attacks.begun[kind], **attacks.longest[kind]} for kind in sorted(attacks.begun)]
    calls = sorted({what for each in attacks.longest.values() for what in each})
    worst = {what: max(each.get(what, 0.0) for each in attacks.longest.values()) for what in calls}
    marks: list[Mark] = [
        at_most("harm to those who did nothing wrong", len(complain.found), 0),
        at_most("leases of others that expired", sum(name in starts(drivers) for name in expired), 0),
        at_least("missions that ended at their goal", len(done), 1),
        at_most("missions that did not", sum(carrier.failed for carrier in carriers), 0),
        at_most("servers that ended or grew", len(grown), 0),
        at_most("errors in logs", len(logged), 0),
        *(at_most(f"longest: {what}, s", took_s, LIMITS_S.get(what, MAX_CALL_S)) for what, took_s in worst.items()),
    ]
    title = f"{sum(attacks.begun.values())} attacks in {minutes:g} minutes; longest calls of others, s"
    return summarize("chaos_attacks", title, rows, marks)


if __name__ == "__main__":
    run(
        main,
        minutes="of attacks",
        drivers="robots that drive, at most 20",
        at_once="attacks at a time",
        seed="of the choice",
        only="this attack only",
        settle="seconds before the attacks",
        quiet="seconds after the first and the last attacks; what clients have forgotten is released after 300",
    )
