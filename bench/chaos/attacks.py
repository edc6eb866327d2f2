"""All attacks at random beside robots, missions and clients that do nothing wrong.

    python -m bench.chaos.attacks [--minutes 30] [--drivers 20] [--at-once 2] [--seed 1] [--only KIND]

A plain system on loopback: everybody may call everything. Twenty robots drive by paths of the planner, two missions
carry tables to and fro again and again, and four clients call all servers, send numbered events from one sub-network to
the other, and resolve names. Meanwhile `at-once` clients attack, each in one of the ways of bench.chaos.attackers for 5
to 20 s; then they are killed and others begin. Attackers have a lower priority of the CPU, as if they were on other
machines. Afterwards everybody must have got what they asked for, and each server must need as much memory, and as many
threads and descriptors, as before."""

from __future__ import annotations

import contextlib
import os
import statistics
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Sequence
from pathlib import Path
from random import Random
from typing import Any, NamedTuple

import psutil

from bench.chaos.attackers import HERE, KINDS, ROBOT, THERE
from bench.chaos.crowd import CARRYING, EXPIRED, Carrier, Complaints, Drivers, Names, Stream, places, two_floors
from bench.common.harness import run
from bench.missions.many import rooms, started
from robocorba.maps import native
from robocorba.testing.json_process import Process, checkout_command
from robocorba.testing.missions import MissionSystem
from robocorba.testing.missions import missions as mission_system
from robocorba.testing.report import PROGRESS, at_least, at_most, bars, summarize
from robocorba.testing.simulation import error_lines

ROOMS = 6
#: Duration of one attack [s].
SHORTEST_S, LONGEST_S = 5.0, 20.0
#: Time before the first attack, and after the last one [s]: a forgotten `pull` ends after 300 s.
SETTLE_S, QUIET_S = 45.0, 320.0
#: Longest call of those who attack nobody, and longest time for which a name leads to somebody else [s].
MAX_CALL_S, MAX_STOLEN_S = 0.5, 2.0
#: What a server may have gained.
MORE_MB, MORE_SHARE, MORE_THREADS, MORE_DESCRIPTORS = 30.0, 0.2, 8, 16


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
        self.begun: Counter[str] = Counter()
        self.longest: dict[str, dict[str, float]] = defaultdict(dict)

    @property
    def kinds(self) -> tuple[str, ...]:
        """Those that run now."""
        return tuple(each.kind for each in self._running)

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
        self._running.remove(attack)


def main(minutes: float = 30.0, drivers: int = 20, at_once: int = 2, seed: int = 1, only: str = "") -> bool:
    of, kinds = rooms(ROOMS), [only] if only else list(KINDS)
    with tempfile.TemporaryDirectory(prefix="robocorba-chaos-") as name, contextlib.ExitStack() as stack:
        folder = Path(name)
        native.save(two_floors(of), folder / "rooms.yaml")
        place = stack.enter_context(mission_system(folder, folder / "rooms.yaml", f"{HERE},{THERE}"))
        stack.enter_context(started(place, places(of, drivers)))
        place.server.renderFloor("L1", 1024)  # what is loaded by the first call belongs to the memory before
        complain = Complaints()
        driving = stack.enter_context(contextlib.closing(Drivers(place, of, drivers, complain)))
        carriers = [Carrier(place, room, complain) for room in of if room.number in CARRYING]
        stream = stack.enter_context(contextlib.closing(Stream(place, complain)))
        names = stack.enter_context(contextlib.closing(Names(place, ROBOT)))
        about = (str(place.running.naming), HERE, ROBOT, f"{of[4].x},{of[4].y}", f"{of[4].x},{of[4].y - 3}")
        bystander = Process(checkout_command("bench.chaos.bystander", *about), folder / "bystander.log")
        stack.enter_context(bystander)
        bystander.receive(60.0)
        for carrier in carriers:
            carrier.start()
        time.sleep(SETTLE_S)
        before = needs(place)
        bystander.ask({"do": "longest"}, 60.0)
        attacks = stack.enter_context(contextlib.closing(Attacks(place, kinds, at_once, seed)))
        began, loads = time.monotonic(), []
        with PROGRESS.status("attacks") as status:
            while (passed := time.monotonic() - began) < 60 * minutes:
                attacks.replace_ended()
                running = attacks.kinds
                time.sleep(1.0)
                loads.append(os.getloadavg()[0])
                calls, errors = bystander.ask({"do": "longest"}, 60.0)
                attacks.note(running, calls)
                for which, error in errors.items():
                    complain.add(f"a client's call of {which} beside {', '.join(running)}: {error}")
                for which, took_s in calls.items():
                    if took_s > MAX_CALL_S:
                        print(f"{passed:.0f} s: a call of {which} took {took_s:.2f} s beside {', '.join(running)}")
                status.update(f"{passed / 60:.1f} of {minutes:g} minutes, {', '.join(running)}")
        attacks.close()
        for carrier in carriers:
            carrier.end()
        time.sleep(QUIET_S)
        after = needs(place)
        expired = EXPIRED.findall((place.running.state / "logs" / "simulation.log").read_text())
        expired = [each for each in expired if "\\x1b" not in each]
        logged = error_lines(place.running.state)
        stolen_s, metres = names.wrong_s, driving.metres
        stream.close()
    print(*logged[:30], *expired[:10], sep="\n")
    seconds = [each for carrier in carriers for each in carrier.seconds]
    rows = [
        {"attack": kind, "times": attacks.begun[kind], **{name: calls.get(name) for name in sorted(calls)}}
        for kind, calls in sorted(attacks.longest.items())
    ]
    for server, then in before.items():
        print(f"{server}: before {then}, after {after.get(server)}")
    print(
        f"{metres:.0f} m driven; {len(seconds)} missions, {statistics.median(seconds or [0.0]):.1f} s each; "
        f"longest push {stream.pushed_s:.2f} s, delivery {stream.delivered_s:.2f} s; "
        f"load {statistics.median(loads or [0.0]):.1f}, at most {max(loads, default=0.0):.1f}"
    )
    grown = [
        server
        for server, then in before.items()
        if (now := after.get(server)) is None
        or now.pid != then.pid
        or now.mb > then.mb * (1 + MORE_SHARE) + MORE_MB
        or now.threads > then.threads + MORE_THREADS
        or now.descriptors > then.descriptors + MORE_DESCRIPTORS
    ]
    longest = {name: max(row[name] or 0.0 for row in rows) for name in rows[0] if name not in ("attack", "times")}
    marks: list[Any] = [
        at_most("harm to those who did nothing wrong", len(complain.found), 0),
        at_most("leases of others that expired", len(expired), 0),
        at_least("missions that ended at their goal", len(seconds) - sum(each.failed for each in carriers), 1),
        at_most("missions that did not", sum(each.failed for each in carriers), 0),
        *(at_most(f"longest call of {each}, s", took_s, MAX_CALL_S) for each, took_s in longest.items()),
        at_most("longest time for an event, s", stream.delivered_s, MAX_CALL_S),
        at_most("a name led to somebody else, s", stolen_s, MAX_STOLEN_S),
        at_most("servers that ended or grew", len(grown), 0),
        at_most("errors in logs", len(logged), 0),
    ]
    worst = {str(row["attack"]): max(row[name] or 0.0 for name in longest) for row in rows}
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
    )
