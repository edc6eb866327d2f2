"""All attacks at random beside robots, missions and clients that do nothing wrong.

    python -m bench.chaos.attacks [--minutes 30] [--drivers 20] [--at-once 2] [--seed 1] [--only KIND] [--quiet 320]

A plain system on loopback: everybody may call everything. Twenty robots drive by paths of the planner, two missions
carry tables to and fro again and again, and four clients call all servers, send numbered events from one sub-network to
the other, and resolve names. Meanwhile `at-once` clients attack, each in one of the ways of bench.chaos.attackers for 5
to 20 s; then they are killed and others begin. Attackers have a lower priority of the CPU, as if they were on other
machines. Afterwards everybody must have got what they asked for, and each server must need as many threads and
descriptors as before, and as much memory as after a third of the attacks: allocators keep what was once needed at the
same time. Before memory is measured the ten thousand nodes are removed that attackers left on the map."""

from __future__ import annotations

import contextlib
import os
import statistics
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from pathlib import Path
from random import Random
from typing import Any, NamedTuple

import psutil
from omniORB import CORBA

from bench.chaos.attackers import HERE, KINDS, ROBOT, THERE, Attacker, removal
from bench.chaos.beside import MAX_CALL_S, UNTOUCHED, Beside, Complaints, beside
from bench.chaos.crowd import CARRYING, EXPIRED, Carrier, Drivers, Names, Stream, places, two_floors
from bench.common.harness import run
from bench.missions.many import Room, rooms, started
from robocorba.events.blocking_budget import BUDGET_S
from robocorba.map_editor import native
from robocorba.stubs import RoboCorba
from robocorba.system.backoff import Backoff
from testkit.json_process import Process, checkout_command
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
#: Timeout of the edits that remove what attackers left on the map [s].
EDIT_TIMEOUT_S = 60.0
#: Pauses after a call that waited in vain behind those of attackers.
AGAIN = Backoff(1.0, 1.0)
#: Longest time for which a name leads to somebody else [s]. Its owner looks after it every two seconds.
MAX_STOLEN_S = 2.0
#: Processes that an event passes: two channels and its consumer. Each may wait for what the machine itself needs.
HOPS = 3
#: Private memory that a server may have gained [MB], beside a share of what it had: allocators keep freed memory.
MORE_MB, MORE_SHARE = 30.0, 0.2
#: Threads that a server may have gained: those of connections that others have just opened.
MORE_THREADS = 8
#: Descriptors that a server may have gained.
MORE_DESCRIPTORS = 16


class Needs(NamedTuple):
    """What a process needs. MB: of private memory."""

    pid: int
    mb: float
    threads: int
    descriptors: int


def needs(place: MissionSystem) -> dict[str, Needs]:
    """Of each server."""
    found = {}
    for row in place.running.record().processes:
        with contextlib.suppress(psutil.NoSuchProcess):
            process = psutil.Process(row.pid)
            found[row.name] = Needs(
                row.pid, process.memory_full_info().uss / 1e6, process.num_threads(), process.num_fds()
            )
    return found


class Attack(NamedTuple):
    """A running attack."""

    kind: str
    process: Process
    until: float


class Attacks:
    """Attacks at random, `at_once` at a time."""

    def __init__(self, place: MissionSystem, kinds: Sequence[str], at_once: int, seed: int) -> None:
        endpoints = [row.endpoint for row in place.running.record().processes if row.endpoint]
        self._arguments, self._log = (str(place.running.naming), endpoints), place.folder / "attackers.log"
        self._kinds, self._at_once, self._random = kinds, at_once, Random(seed)
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

    def replace_ended(self) -> None:
        """Kill attackers whose time has passed, and start others."""
        for each in self._running[:]:
            if time.monotonic() > each.until:
                self._end(each)
        while len(self._running) < self._at_once:
            left = [kind for kind in self._kinds if kind not in self.kinds] or self._kinds
            least = min(self.begun[kind] for kind in left)
            kind = self._random.choice([kind for kind in left if self.begun[kind] <= least + 1])
            seed = str(self._random.randrange(2**31))
            naming, endpoints = self._arguments
            command = checkout_command("bench.chaos.attackers", naming, kind, seed, *endpoints)
            until = time.monotonic() + self._random.uniform(SHORTEST_S, LONGEST_S)
            self._running.append(Attack(kind, Process(command, self._log), until))
            self.begun[kind] += 1

    def note(self, kinds: Sequence[str], calls: dict[str, float]) -> None:
        """Note the longest calls of others while attacks ran."""
        for kind in kinds:
            for name, took_s in calls.items():
                self.longest[kind][name] = max(took_s, self.longest[kind].get(name, 0.0))

    def close(self) -> None:
        for each in self._running[:]:
            self._end(each)

    def _end(self, attack: Attack) -> None:
        with attack.process:
            attack.process.kill()
        if attack.kind == BLOCKING:
            self._held_up_until = time.monotonic() + BUDGET_S
        self._running.remove(attack)


class Outcome(NamedTuple):
    """What was measured, once all have ended. before, between, after: what servers needed before all attacks, after
    the first ones, and in the end; expired: robots whose leases expired, except those of attackers, which forget
    theirs; logged: errors."""

    seconds: list[float]
    failed: int
    metres: float
    stolen_s: float
    stream: Stream
    before: dict[str, Needs]
    between: dict[str, Needs]
    after: dict[str, Needs]
    expired: list[str]
    logged: list[str]

    @property
    def grown(self) -> list[str]:
        """Servers that ended, or need more threads or descriptors than before, or more memory than in between."""
        return [
            server
            for server, then in self.before.items()
            if (now := self.after.get(server)) is None
            or now.pid != then.pid
            or now.mb > self.between.get(server, then).mb * (1 + MORE_SHARE) + MORE_MB
            or now.threads > then.threads + MORE_THREADS
            or now.descriptors > then.descriptors + MORE_DESCRIPTORS
        ]

    def marks(self, untouched_s: float) -> list[Mark]:
        """untouched_s: the longest call of a server that nobody attacks [s]."""
        return [
            at_most("leases of others that expired", len(self.expired), 0),
            at_least("missions that ended at their goal", len(self.seconds), 1),
            at_most("missions that did not", self.failed, 0),
            at_most("longest time for an event, s", self.stream.delivered_s, max(MAX_CALL_S, HOPS * untouched_s)),
            at_most("the same while consumers block suppliers, s", self.stream.held_up_s, BUDGET_S + MAX_CALL_S),
            at_most("a name led to somebody else, s", self.stolen_s, MAX_STOLEN_S),
            at_most("servers that ended or grew", len(self.grown), 0),
            at_most("errors in logs", len(self.logged), 0),
        ]


def measure(
    place: MissionSystem,
    of: Sequence[Room],
    drivers: int,
    complain: Complaints,
    attack: Callable[[float], None],
    minutes: float,
    settle: float,
    quiet: float,
    is_held_up: Callable[[], bool],
) -> Outcome:
    """Let robots, missions and clients work before, during and after the attacks. attack: for a number of
    minutes; settle, quiet: durations [s]."""
    with contextlib.ExitStack() as stack:
        place.server.renderFloor("L1", 1024)  # what is loaded by the first call belongs to the memory before
        driving = stack.enter_context(contextlib.closing(Drivers(place, of, drivers, complain)))
        carriers = [Carrier(place, room, complain) for room in of if room.number in CARRYING]
        stream = stack.enter_context(contextlib.closing(Stream(place, complain, is_held_up)))
        names = stack.enter_context(contextlib.closing(Names(place, ROBOT)))
        for carrier in carriers:
            carrier.start()
        time.sleep(settle)
        before = needs(place)
        attack(FIRST * minutes)
        time.sleep(quiet)
        between = needs(place)
        attack((1 - FIRST) * minutes)
        for carrier in carriers:
            carrier.end()
        time.sleep(quiet)
        after = needs(place)
        robots = places(of, drivers)
        found = EXPIRED.findall((place.running.state / "logs" / "simulation.log").read_text())
        return Outcome(
            seconds=[each for carrier in carriers for each in carrier.seconds],
            failed=sum(carrier.failed for carrier in carriers),
            metres=driving.metres,
            stolen_s=names.wrong_s,
            stream=stream,
            before=before,
            between=between,
            after=after,
            expired=[name for name in found if name in robots],
            logged=error_lines(place.running.state),
        )


def attack_for(seconds: float, attacks: Attacks, bystander: Beside) -> list[float]:
    """Attack; return the load average of each second."""
    loads = []
    bystander.begin()
    began = time.monotonic()
    with PROGRESS.status("attacks") as status:
        while (passed := time.monotonic() - began) < seconds:
            attacks.replace_ended()
            running = attacks.kinds
            bystander.complain.beside = ", ".join(running)
            time.sleep(1.0)
            loads.append(os.getloadavg()[0])
            attacks.note(running, bystander.look())
            status.update(f"{passed / 60:.1f} of {seconds / 60:g} minutes, {', '.join(running)}")
    attacks.close()
    return loads


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
    of, complain, loads = rooms(ROOMS), Complaints(), [0.0]
    with tempfile.TemporaryDirectory(prefix="robocorba-chaos-") as name, contextlib.ExitStack() as stack:
        folder = Path(name)
        native.save(two_floors(of), folder / "rooms.yaml")
        place = stack.enter_context(mission_system(folder, folder / "rooms.yaml", f"{HERE},{THERE}"))
        stack.enter_context(started(place, places(of, drivers)))
        points = (f"{of[4].x},{of[4].y}", f"{of[4].x},{of[4].y - 3}")
        bystander = stack.enter_context(beside(folder, place.running.naming, (HERE, ROBOT, *points), complain))
        kinds = [only] if only else list(KINDS)
        attacks = stack.enter_context(contextlib.closing(Attacks(place, kinds, at_once, seed)))

        def attack(minutes: float) -> None:
            loads.extend(attack_for(60 * minutes, attacks, bystander))
            clear_floor(place.orb.resolve("MapEditor", RoboCorba.MapEditor, 10.0, EDIT_TIMEOUT_S))

        outcome = measure(place, of, drivers, complain, attack, minutes, settle, quiet, attacks.hold_up_suppliers)
    print(*outcome.logged[:30], *(f"the lease of {name} expired" for name in outcome.expired[:10]), sep="\n")
    complain.print_rest()
    for server, then in outcome.before.items():
        print(f"{server}: {then}, in between {outcome.between.get(server)}, after {outcome.after.get(server)}")
    stream = outcome.stream
    print(
        f"{outcome.metres:.0f} m driven; {len(outcome.seconds)} missions, "
        f"{statistics.median(outcome.seconds or [0.0]):.1f} s each; longest event {stream.delivered_s:.2f} s, "
        f"blocked {stream.held_up_s:.2f} s; load {statistics.median(loads):.1f}, at most {max(loads):.1f}"
    )
    rows = [
        {"attack": kind, "times": attacks.begun[kind], **{each: calls.get(each) for each in bystander.longest}}
        for kind, calls in sorted(attacks.longest.items())
    ]
    marks = [
        at_most("harm to those who did nothing wrong", complain.count, 0),
        *outcome.marks(bystander.longest[UNTOUCHED]),
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
