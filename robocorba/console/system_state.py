"""What the servers, robots and channels report of themselves, for the tables of the console."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Collection
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

from robocorba.console.corba.system_state import Question, channel_state, robot_state, server_state
from robocorba.console.defects import DEFECT
from robocorba.errors.base import RoboCorbaError
from robocorba.orb.orb import Orb
from robocorba.system.names import CHANNELS, ROBOTS
from robocorba.system.repeating import Repeating

_log = logging.getLogger(__name__)

#: Interval between the requests of each object [s].
INTERVAL_S = 0.5
#: An object that does not answer is asked again after this time [s].
RETRY_S = 1.5
#: Robots, and channels, that are remembered after their names have left the naming service.
MAX_GONE = 500
Answer = dict[str, Any]


class _Source:
    """A remote object that is asked again and again, never twice at the same time."""

    def __init__(self, ask: Question) -> None:
        self._ask = ask
        self.answer: Any = None
        #: Time of the last answer on the monotonic clock [s]; and why there is no newer one.
        self.answered_at = 0.0
        self.problem = ""
        self._next_s = 0.0
        self._under_way: Future[None] | None = None

    def refresh(self, threads: ThreadPoolExecutor) -> None:
        if time.monotonic() >= self._next_s and (self._under_way is None or self._under_way.done()):
            self._under_way = threads.submit(self._refresh)

    def _refresh(self) -> None:
        try:
            self.answer = self._ask()
            self.answered_at, self.problem = time.monotonic(), ""
            self._next_s = self.answered_at + INTERVAL_S
            return
        except RoboCorbaError as error:
            self.problem = str(error)
        except Exception:  # such as an answer of another release; the future would hide it
            _log.exception("a request for a state failed")
            self.problem = DEFECT
        self._next_s = time.monotonic() + RETRY_S

    def row(self) -> Answer:
        """The last answer with its age [s], and the problem if there is one."""
        age_s = time.monotonic() - self.answered_at if self.answered_at else None
        return {"state": self.answer, "age": age_s, "problem": self.problem}


class SystemState:
    """Asks the simulation server, all robots and all channels in the background, from `start` to `close`. Thread-safe.

    Robots and channels that were seen once stay in the answer with the age of their last news, until `forget`, or
    until more than MAX_GONE have left."""

    def __init__(self, orb: Orb) -> None:
        self._orb = orb
        # Objects that hang occupy one thread each for 1 s in RETRY_S.
        self._threads = ThreadPoolExecutor(16, "console")
        self._lock = threading.Lock()
        self._server = _Source(server_state(orb))
        self._robots: dict[str, _Source] = {}
        self._channels: dict[str, _Source] = {}
        self._bound: dict[str, frozenset[str]] = {ROBOTS: frozenset(), CHANNELS: frozenset()}
        self._names_problem = "connecting"
        self._task = Repeating("console state", self._refresh, INTERVAL_S / 2)
        self._names_task = Repeating("console names", self._read_names, 2 * INTERVAL_S)

    def start(self) -> None:
        self._task.start()
        self._names_task.start()

    def close(self) -> None:
        self._task.close()
        self._names_task.close()
        self._threads.shutdown(wait=False, cancel_futures=True)

    def forget(self, robot: str) -> None:
        """Drop a robot that has left."""
        with self._lock:
            self._robots.pop(robot, None)

    def rows(self) -> Answer:
        """`server`, and `robots` and `channels` by name: each with `state` (members as in the IDL, None before the
        first answer), `age` [s], `problem` and `bound`, whether its name is in the naming service. `naming`: why the
        naming service does not answer, or has not yet."""
        with self._lock:
            robots, channels = dict(self._robots), dict(self._channels)
        return {
            "naming": self._names_problem,
            "server": self._server.row(),
            "robots": {name: {**of.row(), "bound": name in self._bound[ROBOTS]} for name, of in robots.items()},
            "channels": {name: {**of.row(), "bound": name in self._bound[CHANNELS]} for name, of in channels.items()},
        }

    def _refresh(self) -> None:
        with self._lock:
            sources = [self._server, *self._robots.values(), *self._channels.values()]
        for source in sources:
            source.refresh(self._threads)

    def _read_names(self) -> None:
        try:
            of_kind = ((ROBOTS, self._robots, robot_state), (CHANNELS, self._channels, channel_state))
            for path, sources, question in of_kind:
                self._bound[path] = frozenset(self._orb.names(path))
                with self._lock:
                    for name in sorted(self._bound[path] - sources.keys()):
                        sources[name] = _Source(question(self._orb, name))
                    _forget_oldest(sources, self._bound[path])
            self._names_problem = ""
        except RoboCorbaError as error:
            self._names_problem = str(error)


def _forget_oldest(sources: dict[str, _Source], bound: Collection[str]) -> None:
    """Drop those of which there is no news for longest, beyond MAX_GONE whose names have left."""
    gone = sorted(sources.keys() - bound, key=lambda name: sources[name].answered_at)
    for name in gone[: max(0, len(gone) - MAX_GONE)]:
        del sources[name]
