"""How soon open pages of the console show that a server works again, after it was killed and has returned.

python -m bench.console.returns [--rounds N]

The map editor, the simulation, the channel of a sub-network, the naming service, the console and a robot are killed in
turn (SIGKILL) while the monitor and the map page are open in a headless Chromium. Measured from the first call that
the restarted process answers until the page shows no problem any more, and robots with news of less than a second."""

from __future__ import annotations

import math
import os
import random
import signal
import socket
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple
from urllib.parse import urlsplit

import psutil

from bench.common.harness import folder_of_bench, progress, run
from robocorba.clients.robot_processes import servers
from robocorba.console.corba.system_state import server_state
from robocorba.errors.services import NotReachable
from robocorba.orb.orb import Orb
from robocorba.system.backoff import Backoff
from robocorba.system.corba.remote_supervisor import RemoteSupervisor
from robocorba.system.corba.servers import probe_of
from robocorba.system.names import CHANNELS, CONSOLE, ROBOTS, SUPERVISOR
from robocorba.system.processes import ProcessPhase, ProcessState, RobotOrder
from robocorba.system.state_folder import StateFolder
from robocorba.system.supervision.system import NAMING_SERVICE
from testkit.browser import chromium, headless
from testkit.json_process import ProcessFailed
from testkit.processes import is_running
from testkit.report import PROGRESS, at_most, distribution, summarize

#: Longest time from the return of a process until a page shows it [s].
TARGET_S = 3.0
#: A page works again once it has shown no problem for this time [s]: longer than any pause before it asks again.
HOLD_S = 5.0
#: Timeout of each wait [s]; a killed robot has to be logged off before it can start again.
LIMIT_S = 120.0
#: Timeout of a call that asks a process whether it is there [s], and the pause before the next one.
PROBE_S, POLLING = 0.3, Backoff(0.02, 0.02)
#: A killed robot is started again up to this time after it was logged off [s], as users do: not in step with a page.
USER_S = 3.0
ORDERS = (RobotOrder("R1", channel="a"), RobotOrder("R2", channel="b"))
#: The open pages, and their paths.
PAGES = {"monitor": "", "map": "map"}
SIZE = {"width": 1366, "height": 768}

#: Notes what a page shows at each change: the browser's time [ms since 1970], what is wrong by the place that says so,
#: and whether all robots have news of less than a second.
_WATCH = """() => {
    const all = (query) => [...document.querySelectorAll(query)].map((each) => each.textContent.trim());
    let last = "";
    window.shown = [];
    setInterval(() => {
        const now = { status: all(".console-status.is-problem, .scene-note.is-problem, .console-overlay").join("; "),
            robots: all(".robot-table tr.is-lost td:first-child").join(", "),
            channels: all(".channel-node.is-down title").join(", "),
            isFresh: all(".robot-table tr[data-row] td:last-child").every((age) => /^0\\.\\d s$/.test(age)) };
        const text = JSON.stringify(now);
        if (text !== last) window.shown.push([Date.now(), now]);
        last = text;
    }, 20); }"""
#: Forgets what was shown before now.
_FORGET = "() => { window.shown.splice(0, window.shown.length - 1); }"
_SHOWN = "() => window.shown ?? null"
Shown = Sequence[tuple[float, Mapping[str, Any]]]
#: Where pages say that something is wrong: those of _WATCH.
PLACES = ("status", "robots", "channels")
ROWS = ("status", "robots")


class Case(NamedTuple):
    """What is killed. process: its name at the supervisor. has_returned: whether it answers.

    places: where pages say that it does not work. order: a robot to start again, as no supervisor does."""

    name: str
    process: str
    has_returned: Callable[[], bool]
    places: tuple[str, ...] = ("status",)
    order: RobotOrder | None = None


class Round(NamedTuple):
    """away_s: from the kill to the return. late_s: from there until a page showed it, by page; LIMIT_S if it did not.
    problems: the last one that each page showed; empty for a page that showed none."""

    away_s: float
    late_s: dict[str, float]
    problems: dict[str, str]


class Sight(NamedTuple):
    """What a page has shown. problem: the last one, empty if there was none. ended_s: when that was gone, fresh_s: when
    the news of all robots were fresh after it [s since 1970]; infinity if they are not."""

    problem: str
    ended_s: float
    fresh_s: float


def sight(shown: Shown, places: Iterable[str]) -> Sight:
    """What a page has shown at these places."""
    problems = ["; ".join(filter(None, (now[place] for place in places))) for _, now in shown]
    last = max((number for number, problem in enumerate(problems) if problem), default=-1)
    after = [(at / 1e3, now["isFresh"]) for at, now in shown[last + 1 :]]
    fresh_s = next((at_s for at_s, is_fresh in after if is_fresh), math.inf)
    return Sight(problems[last] if last >= 0 else "", after[0][0] if after else math.inf, fresh_s)


class System:
    """A running system with robots and open pages. Every wait raises ProcessFailed after LIMIT_S."""

    def __init__(self, state: Path, orb: Orb, pages: Mapping[str, Any]) -> None:
        self._orb, self._pages = orb, pages
        self._supervisor = RemoteSupervisor(orb, state / SUPERVISOR)
        console = urlsplit(console_address(state))
        self._console = str(console.hostname), int(console.port or 80)
        self._simulation = server_state(orb)

    def start_robot(self, order: RobotOrder) -> None:
        """Start a robot that does not run, and wait until it is ready."""
        self._supervisor.start_robot(order)
        until(lambda: self._row(order.process).phase is not ProcessPhase.STARTING, f"start of {order.process}")
        if self._row(order.process).phase is not ProcessPhase.READY:
            raise ProcessFailed(f"{order.process} did not start; its log says why")

    def cases(self) -> list[Case]:
        first, *_ = ORDERS
        robot, channel = f"{ROBOTS}/{first.name}", f"{CHANNELS}/{first.channel}"
        return [
            Case("map editor", "map_editor", lambda: self.answers("MapEditor", "PathPlanner")),
            Case("simulation", "simulation", lambda: self.answers("SimulationServer", "OmniDatabase"), ROWS),
            Case("channel", f"events_{first.channel}", lambda: self.answers(channel), ("status", "channels")),
            Case("naming service", NAMING_SERVICE, self.has_names),
            Case("console", CONSOLE, self.has_console, PLACES),
            Case("robot", first.process, lambda: self.answers(robot), ROWS, first),
        ]

    def round(self, case: Case) -> Round:
        """Kill it once. Raises ProcessFailed where it, or what a page shows, does not come back."""
        time.sleep(random.uniform(0.0, 1.0))  # anywhere between the requests of a page
        process = psutil.Process(self._row(case.process).pid)
        for page in self._pages.values():
            page.evaluate(_FORGET)
        killed_s = time.time()
        os.kill(process.pid, signal.SIGKILL)
        until(lambda: not is_running(process), f"end of {case.process}")
        if order := case.order:
            until(lambda: order.name not in self.robots(), f"end of the session of {order.name}")
            time.sleep(random.uniform(0.0, USER_S))
            self._supervisor.start_robot(order)
        until(lambda: self._row(case.process).pid not in (0, process.pid), f"start of {case.process}")
        until(case.has_returned, f"return of {case.process}")
        returned_s = time.time()
        seen = {name: self._settled(page, returned_s, case.places) for name, page in self._pages.items()}
        late_s = {name: min(max(0.0, page.fresh_s - returned_s), LIMIT_S) for name, page in seen.items()}
        return Round(returned_s - killed_s, late_s, {name: page.problem for name, page in seen.items()})

    @staticmethod
    def _settled(page: Any, returned_s: float, places: Sequence[str]) -> Sight:
        """What a page has shown once it has shown no problem for HOLD_S since the return, or LIMIT_S later."""
        while True:
            shown = page.evaluate(_SHOWN)
            if shown is None:
                raise ProcessFailed("the page was loaded again")
            seen, now_s = sight(shown, places), time.time()
            is_settled = math.isfinite(seen.fresh_s) and now_s - max(returned_s, seen.ended_s) > HOLD_S
            if is_settled or now_s - returned_s > LIMIT_S:
                return seen
            time.sleep(POLLING.max_s)

    # ---- whether a process is there ----

    def answers(self, *names: str) -> bool:
        return all(_is_there(partial(self._probe, name)) for name in names)

    def _probe(self, name: str) -> None:
        probe = probe_of(name)
        assert probe is not None
        probe.call_object(self._orb, name, PROBE_S)

    def robots(self) -> set[str]:
        """The robots that the simulation has; none while it does not answer."""
        with suppress(NotReachable):
            return {client["name"] for client in self._simulation()["clients"]}
        return set()

    def has_names(self) -> bool:
        return _is_there(lambda: self._orb.check_naming(PROBE_S))

    def has_console(self) -> bool:
        return _is_there(lambda: socket.create_connection(self._console, PROBE_S).close())

    def _row(self, process: str) -> ProcessState:
        return next(row for row in self._supervisor.processes() if row.name == process)


def _is_there(call: Callable[[], object]) -> bool:
    try:
        call()
    except (NotReachable, OSError):
        return False
    return True


def until(condition: Callable[[], bool], what: str) -> None:
    if not POLLING.poll(condition, LIMIT_S):
        raise ProcessFailed(f"not within {LIMIT_S:g} s: {what}")


def console_address(state: Path) -> str:
    record = StateFolder(state).read_record()
    assert record is not None
    return record.console_address


@contextmanager
def running_system(browser: str) -> Iterator[System]:
    """A system of its own with two robots, and its pages in a browser."""
    options = ("--subnets", "a,b", "--console", "--console-port", "0")
    with folder_of_bench() as state, ExitStack() as stack:
        orb = stack.enter_context(Orb(stack.enter_context(servers(state, *options))))
        started = stack.enter_context(headless(browser))
        pages = {name: started.new_page(viewport=SIZE) for name in PAGES}  # type: ignore[arg-type]
        system = System(state, orb, pages)
        for order in ORDERS:
            system.start_robot(order)
        for name, page in pages.items():
            page.goto(console_address(state) + PAGES[name])
        pages["monitor"].get_by_role("tab", name="Channels").click()
        for name, page in pages.items():
            page.evaluate(_WATCH)
            until(lambda: math.isfinite(sight(page.evaluate(_SHOWN), PLACES).fresh_s), f"{name} page")  # noqa: B023
        yield system


def row_of(name: str, rounds: Sequence[Round]) -> dict[str, Any]:
    """A row of the table, of the rounds of one case."""
    row: dict[str, Any] = {"killed": name, "rounds": len(rounds), "away s": median(each.away_s for each in rounds)}
    for page in PAGES:
        late_s = [each.late_s[page] for each in rounds]
        row |= {f"{page}: median s": median(late_s), f"{page}: worst s": max(late_s)}
        row[f"{page}: said so"] = sum(bool(each.problems[page]) for each in rounds)
    return row


def measure(rounds: int = 5) -> bool:
    browser = chromium()
    if browser is None:
        raise ProcessFailed("Chromium is missing")
    found: dict[str, list[Round]] = {}
    with running_system(browser) as system:
        for case in system.cases():
            found[case.name] = [system.round(case) for _ in progress(range(rounds), case.name)]
            PROGRESS.print(row_of(case.name, found[case.name]))
    rows = [row_of(name, of_case) for name, of_case in found.items()]
    marks = [
        at_most(f"{row['killed']}: worst on the {page} page, s", row[f"{page}: worst s"], TARGET_S)
        for row in rows
        for page in PAGES
    ]
    samples = {
        f"{name}, {page}": [one.late_s[page] for one in of_case] for name, of_case in found.items() for page in PAGES
    }
    draw = distribution(samples, "s from its return until the page shows it", "share of rounds")
    return summarize("console_returns", "From the return of a process until a page shows it", rows, marks, draw)


if __name__ == "__main__":
    run(measure, rounds="kills of each process")
