"""kill -9 and SIGSTOP of each server while a client calls it: how long it is away.

    python -m bench.starts.kills [--rounds 6] [--hangs 1] [--only NAME]

A process calls one object 200 times a second with a timeout of 1 s, by a reference that it keeps. `away` is the longest
time without an answer. A server that is stopped is not continued: the supervisor must notice that it hangs."""

from __future__ import annotations

import contextlib
import random
import time
from collections import defaultdict
from collections.abc import Iterator
from itertools import pairwise
from statistics import median

import CosNaming
from omniORB import CORBA

from bench.common.harness import progress, run, sampled, system
from robocorba.orb.naming import PROBE_TIMEOUT_S
from robocorba.orb.orb import Orb
from robocorba.system.corba.servers import Probe, probe_of
from robocorba.system.settings import Address
from robocorba.system.supervision.hangs import HangLimit
from robocorba.system.supervision.system import NAMING_SERVICE
from testkit.faults import kill
from testkit.json_process import ObjectProcess
from testkit.processes import Running, eventually, hang
from testkit.report import Mark, at_most, summarize, summary

#: Objects of the servers that `robocorba up` starts by default.
OBJECTS = {
    NAMING_SERVICE: "NameService",
    "map_editor": "MapEditor",
    "simulation": "SimulationServer",
    "sensor_s1": "VirtualSensors/s1",
    "events_main": "EventChannels/main",
}
#: Interval between calls, and timeout of each call [s].
INTERVAL_S, CALL_TIMEOUT_S = 0.005, 1.0
#: Timeout for a server to be back [s], and time with answers before and after it was away [s].
LIMIT_S, AROUND_S = 300.0, 0.3
#: Longest pause between faults [s], of random length, so that they do not follow the beat of the supervisor's checks.
MAX_PAUSE_S = 0.3
#: Required median and worst time of a killed server [s].
MAX_MEDIAN_S, MAX_WORST_S = 0.6, 1.2
#: Required time until a stopped server is back [s]: the limit, the timeout of the last call, and a start.
MAX_HANG_S = HangLimit().limit_s + PROBE_TIMEOUT_S + 1.2


class Caller:
    """Calls an object in a thread. Times are those of time.monotonic, which all processes of a machine share."""

    def __init__(self, orb: Orb) -> None:
        self._orb, self._calling = orb, contextlib.ExitStack()
        self._answers: list[tuple[float, bool]] = []

    def begin(self, endpoint: str, name: str) -> None:
        """Call an object until `end`."""
        naming = Probe(CosNaming.NamingContext, lambda context: context._non_existent())
        probe = naming if name == OBJECTS[NAMING_SERVICE] else probe_of(name)
        assert probe is not None
        reference = self._orb.reference(f"corbaloc:iiop:1.2@{endpoint}/{name}", probe.interface, CALL_TIMEOUT_S)

        def answers() -> bool:
            with contextlib.suppress(CORBA.SystemException):
                probe.call(reference)
                return True
            return False

        self._answers = self._calling.enter_context(sampled(answers, INTERVAL_S))

    def answered(self, since: float) -> list[float]:
        """The times of the answers since a time."""
        return [at for at, has_answered in list(self._answers) if has_answered and at > since]

    def end(self) -> None:
        self._calling.close()


@contextlib.contextmanager
def caller() -> Iterator[Caller]:
    with Orb(Address("127.0.0.1", 1)) as orb:  # port 1 is unused: nothing is resolved
        yield Caller(orb)


def away_s(running: Running, calls: ObjectProcess, server: str, hangs: bool) -> float:
    """How long a server is away after a fault [s]."""

    def until_answered(since: float) -> None:
        eventually(lambda: calls.call("answered", since), LIMIT_S, f"an answer of {server}")
        time.sleep(AROUND_S)

    endpoint, pid = next((row.endpoint, row.pid) for row in running.record().processes if row.name == server)
    calls.call("begin", endpoint, OBJECTS[server])
    until_answered(time.monotonic())
    began = time.monotonic()
    (hang if hangs else kill)(pid)
    eventually(lambda: running.is_again(server, pid), LIMIT_S, f"{server} again")
    until_answered(time.monotonic())
    answers = calls.call("answered", began - AROUND_S)
    calls.call("end")
    rows = running.record
    eventually(lambda: (server, "running") in [(r.name, r.state) for r in rows().processes], LIMIT_S, f"{server} runs")
    return max(later - earlier for earlier, later in pairwise(answers))


def marks_of(found: dict[tuple[str, str], list[float]]) -> list[Mark]:
    marks = []
    for (server, fault), values in found.items():
        if fault == "SIGSTOP":
            marks.append(at_most(f"{server} stopped: away, s", max(values), MAX_HANG_S))
        elif server != NAMING_SERVICE:  # is a program of its own, and starts alone
            marks.append(at_most(f"{server} killed: away, median, s", median(values), MAX_MEDIAN_S))
            marks.append(at_most(f"{server} killed: away, worst, s", max(values), MAX_WORST_S))
    return marks


def main(rounds: int = 6, hangs: int = 1, only: str = "") -> bool:
    found: dict[tuple[str, str], list[float]] = defaultdict(list)
    chosen = [server for server in OBJECTS if only in server]
    faults = [(server, "kill -9") for _ in range(rounds) for server in chosen]
    faults += [(server, "SIGSTOP") for _ in range(hangs) for server in chosen]
    with system("--hang-limit", f"{HangLimit().limit_s:g}") as place, ObjectProcess(caller) as calls:
        for server, fault in progress(faults, "kill -9 and SIGSTOP"):
            time.sleep(random.uniform(0.0, MAX_PAUSE_S))
            found[server, fault].append(away_s(place.running, calls, server, fault == "SIGSTOP"))
    rows = [
        {"server": server, "fault": fault, "faults": len(values), **summary(values, "away, median, s", worst="most")}
        for (server, fault), values in found.items()
    ]
    samples = {", ".join(key): values for key, values in found.items()}
    return summarize("starts_kills", "a server that is killed or stopped", rows, marks_of(found), samples, "s")


if __name__ == "__main__":
    run(main, rounds="kills of each server", hangs="stops of each server", only="servers with this in their name")
