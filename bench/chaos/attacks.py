"""All attacks at random beside robots, missions and clients that do nothing wrong.

    python -m bench.chaos.attacks [--minutes 30] [--drivers 20] [--at-once 2] [--seed 1] [--only KIND] [--quiet 320]

A plain system on loopback: everybody may call everything. Twenty robots drive by paths of the planner, two missions
carry tables to and fro again and again, and clients call all servers, send numbered events from one sub-network to the
other, and resolve names. Meanwhile `at-once` clients attack, each in one of the ways of bench.chaos.attackers for 5 to
20 s; then they are killed and others begin. Attackers have a lower priority of the CPU, as if they were on other
machines. Afterwards everybody must have got what they asked for, and each server must need as many threads and
descriptors as before, and as much memory as after a third of the attacks: allocators keep what was once needed at the
same time. Before memory is measured the ten thousand nodes are removed that attackers left on the map."""

from __future__ import annotations

import contextlib
import os
import statistics
import time
from collections import Counter, defaultdict
from collections.abc import Sequence
from random import Random
from typing import Any, NamedTuple

import psutil
from omniORB import CORBA

from bench.chaos.attackers import HERE, KINDS, ROBOT, THERE, Attacker, removal
from bench.chaos.beside import MAX_CALL_S, UNTOUCHED, Beside, Complaints, beside, numbered_events
from bench.chaos.crowd import CARRYING, EXPIRED, Carrier, Drivers, Names, places, two_floors
from bench.common.harness import folder_of_bench, run
from bench.missions.many import rooms
from robocorba.events.blocking_budget import BUDGET_S
from robocorba.stubs import RoboCorba
from robocorba.system.backoff import Backoff
from testkit.json_process import ObjectProcess, Process, checkout_command
from testkit.missions import MissionSystem
from testkit.missions import missions as mission_system
from testkit.report import PROGRESS, Mark, at_least, at_most, bars, summarize
from testkit.simulation import error_lines

#: The attack by consumers that block suppliers, for BUDGET_S a minute.
BLOCKING = Attacker.absent_consumers.__name__
#: Rooms of the building: two with a mission, four with the lanes of up to 20 robots.
ROOMS = 6
#: Duration of one attack [s].
SHORTEST_S, LONGEST_S = 5.0, 20.0
#: Time before the first attack [s]: every server has been called, and has what it loads at its first calls.
SETTLE_S = 45.0
#: Share of the attacks after which memory is measured that must not grow any more.
FIRST = 1 / 3
#: Time after the first and after the last attacks [s]: a forgotten `pull` ends after 300 s.
QUIET_S = 320.0
#: Timeout of the edits that remove what attackers left on the map [s], and pauses after calls that waited in vain.
EDIT_TIMEOUT_S, AGAIN = 60.0, Backoff(1.0, 1.0)
#: Longest time for which a name leads to somebody else [s]. Its owner looks after it every two seconds.
MAX_STOLEN_S = 2.0
#: Processes that an event passes: two channels and its consumer. Each may wait for what the machine itself needs.
HOPS = 3
#: Private memory that a server may have gained [MB], beside a share of what it had: allocators keep freed memory.
MORE_MB, MORE_SHARE = 30.0, 0.2
#: Threads (of connections that others have just opened) and descriptors that a server may have gained.
MORE_THREADS, MORE_DESCRIPTORS = 8, 16


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
    """Attacks at random, `at_once` at a time."""

    def __init__(self, place: MissionSystem, kinds: Sequence[str], at_once: int, seed: int) -> None:
        self._endpoints = [row.endpoint for row in place.running.record().processes if row.endpoint]
        self._place, self._kinds, self._at_once, self._random = place, kinds, at_once, Random(seed)
        self._running: list[Attack] = []
        self._held_up_until = 0.0
        self.begun: Counter[str] = Counter()
        self.longest: dict[str, dict[str, float]] = defaultdict(dict)

    @property
    def kinds(self) -> tuple[str, ...]:
        """Those that run now."""
        return tuple(each.kind for each in self._running)

    def hold_up_suppliers(self) -> bool:
        """Whether consumers block suppliers, or did until a moment ago. BLOCK_SUPPLIER allows that."""
        return BLOCKING in self.kinds or time.monotonic() < self._held_up_until

    def attack(self, minutes: float, bystander: Beside, stream: Stream) -> None:
        """Attack, and note the longest calls and events of others."""
        bystander.begin()
        until = time.monotonic() + 60 * minutes
        with PROGRESS.status("attacks") as status:
            while (left_s := until - time.monotonic()) > 0.0:
                self._replace_ended()
                running = self.kinds
                bystander.complain.beside = ", ".join(running)
                time.sleep(1.0)
                stream.look()
                for name, took_s in bystander.look().items():
                    for kind in running:
                        self.longest[kind][name] = max(took_s, self.longest[kind].get(name, 0.0))
                status.update(f"{left_s / 60:.1f} of {minutes:g} minutes left, {', '.join(running)}")
        self.close()

    def close(self) -> None:
        for each in self._running[:]:
            self._end(each)

    def _replace_ended(self) -> None:
        """Kill attackers whose time has passed, and start others."""
        for each in self._running[:]:
            if time.monotonic() > each.until:
                self._end(each)
        while len(self._running) < self._at_once:
            left = [kind for kind in self._kinds if kind not in self.kinds] or self._kinds
            least = min(self.begun[kind] for kind in left)
            kind = self._random.choice([kind for kind in left if self.begun[kind] <= least + 1])
            arguments = (str(self._place.running.naming), kind, str(self._random.randrange(2**31)), *self._endpoints)
            process = Process(
                checkout_command("bench.chaos.attackers", *arguments), self._place.folder / "attackers.log"
            )
            until = time.monotonic() + self._random.uniform(SHORTEST_S, LONGEST_S)
            self._running.append(Attack(kind, process, until))
            self.begun[kind] += 1

    def _end(self, attack: Attack) -> None:
        with attack.process:
            attack.process.kill()
        if attack.kind == BLOCKING:
            self._held_up_until = time.monotonic() + BUDGET_S
        self._running.remove(attack)


class Stream:
    """Looks after the numbered events. delivered_s: the longest time for one [s]; held_up_s: the same while consumers
    hold up suppliers."""

    def __init__(self, process: ObjectProcess, complain: Complaints, attacks: Attacks) -> None:
        self._process, self._complain, self._attacks = process, complain, attacks
        self.delivered_s = self.held_up_s = 0.0

    def look(self, command: str = "news") -> None:
        is_held_up = self._attacks.hold_up_suppliers()
        longest_s, slow, wrong = self._process.call(command)
        for each in wrong:
            self._complain.add(each)
        if is_held_up:
            self.held_up_s = max(self.held_up_s, longest_s)
            return
        self.delivered_s = max(self.delivered_s, longest_s)
        for each in slow:
            self._complain.note(each)


def clear_floor(editor: Any) -> None:
    """Remove the nodes that attackers left on their floor, once the editor has answered their last calls, and one of
    their transactions counts as forgotten."""
    AGAIN.call(lambda: removal(editor), EDIT_TIMEOUT_S, CORBA.TRANSIENT, RoboCorba.TooManyTransactions).commit()


def main(
    minutes: float = 30.0,
    drivers: int = 20,
    at_once: int = 2,
    seed: int = 1,
    only: str = "",
    settle: float = SETTLE_S,
    quiet: float = QUIET_S,
) -> bool:
    of, complain = rooms(ROOMS), Complaints()
    found: list[dict[str, Needs]] = []
    with folder_of_bench() as folder, contextlib.ExitStack() as stack:
        place = stack.enter_context(mission_system(folder, two_floors(of), f"{HERE},{THERE}"))
        starts = places(of, drivers)
        place.start(starts)
        points = (f"{of[4].x},{of[4].y}", f"{of[4].x},{of[4].y - 3}")
        bystander = stack.enter_context(beside(place.running.naming, (HERE, ROBOT, *points), complain))
        kinds = [only] if only else list(KINDS)
        attacks = stack.enter_context(contextlib.closing(Attacks(place, kinds, at_once, seed)))
        editor = place.orb.resolve("MapEditor", RoboCorba.MapEditor, 10.0, EDIT_TIMEOUT_S)
        place.server.renderFloor("L1", 1024)  # what is loaded by the first call belongs to the memory before
        stack.enter_context(contextlib.closing(Drivers(place, of, drivers, complain)))
        carriers = [Carrier(place, room, complain) for room in of if room.number in CARRYING]
        events = stack.enter_context(ObjectProcess(numbered_events, place.running.naming, HERE, THERE))
        stream = Stream(events, complain, attacks)
        names = stack.enter_context(contextlib.closing(Names(place)))
        for carrier in carriers:
            carrier.start()
        time.sleep(settle)
        found.append(needs(place))
        for share in (FIRST, 1 - FIRST):
            attacks.attack(share * minutes, bystander, stream)
            clear_floor(editor)
            for carrier in carriers if share != FIRST else ():
                carrier.end()
            time.sleep(quiet)
            found.append(needs(place))
        stream.look("last")
        logged = error_lines(place.running.state)
        expired = EXPIRED.findall((place.running.state / "logs" / "simulation.log").read_text())
    print(*logged[:30], *(f"the lease of {name} expired" for name in expired if name in starts), sep="\n")
    complain.print_rest()
    before, between, after = found
    for server, then in before.items():
        print(f"{server}: {then}, in between {between.get(server)}, after {after.get(server)}")
    seconds = [each for carrier in carriers for each in carrier.seconds]
    print(f"{len(seconds)} missions, {statistics.median(seconds or [0.0]):.1f} s each; load {os.getloadavg()[0]:.1f}")
    rows = [
        {"attack": kind, "times": attacks.begun[kind], **{each: calls.get(each) for each in bystander.longest}}
        for kind, calls in sorted(attacks.longest.items())
    ]
    grown = [
        server
        for server, then in before.items()
        if server not in after or after[server].is_grown(then, between.get(server, then))
    ]
    untouched_s = bystander.longest[UNTOUCHED]
    marks: list[Mark] = [
        at_most("harm to those who did nothing wrong", complain.count, 0),
        at_most("leases of others that expired", sum(name in starts for name in expired), 0),
        at_least("missions that ended at their goal", len(seconds), 1),
        at_most("missions that did not", sum(carrier.failed for carrier in carriers), 0),
        at_most("longest time for an event, s", stream.delivered_s, max(MAX_CALL_S, HOPS * untouched_s)),
        at_most("the same while consumers block suppliers, s", stream.held_up_s, BUDGET_S + MAX_CALL_S),
        at_most("a name led to somebody else, s", names.wrong_s, MAX_STOLEN_S),
        at_most("servers that ended or grew", len(grown), 0),
        at_most("errors in logs", len(logged), 0),
        *bystander.marks(),
    ]
    worst = {kind: max(calls.values()) for kind, calls in sorted(attacks.longest.items())}
    title = f"{sum(attacks.begun.values())} attacks in {minutes:g} minutes"
    return summarize("chaos_attacks", title, rows, marks, bars(worst, "longest call of others, s"))


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
