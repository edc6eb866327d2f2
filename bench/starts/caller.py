"""Calls an object again and again, by a reference that it keeps, and notes when it answered.

    python -m bench.starts.caller

It prints `null`, then answers lines of JSON on stdin: `begin` calls the object `name` at `endpoint` until `end`;
`answered` returns the times of the answers since a time. All times are those of time.monotonic, which all processes of
a machine share."""

from __future__ import annotations

import contextlib
import threading
import time
from typing import Any

import CosNaming
from omniORB import CORBA

from robocorba.orb.orb import Orb
from robocorba.system.corba.servers import Probe, probe_of
from robocorba.system.settings import Address
from testkit.json_process import answer_commands

#: Interval between calls, and timeout of each call [s].
INTERVAL_S, CALL_TIMEOUT_S = 0.005, 1.0
#: The naming service is called too, but nothing is resolved by it.
NAMING_SERVICE = "NameService"
_NAMING_SERVICE = Probe(CosNaming.NamingContext, lambda context: context._non_existent())


class Caller:
    """One thread that calls."""

    def __init__(self, orb: Orb) -> None:
        self._orb = orb
        self._ended = threading.Event()
        self._thread: threading.Thread | None = None
        self._answers: list[float] = []

    def begin(self, endpoint: str, name: str) -> None:
        self.end()
        probe = _NAMING_SERVICE if name == NAMING_SERVICE else probe_of(name)
        assert probe is not None
        reference = self._orb.reference(f"corbaloc:iiop:1.2@{endpoint}/{name}", probe.interface, CALL_TIMEOUT_S)
        self._ended, self._answers = threading.Event(), []
        self._thread = threading.Thread(target=self._call, args=(probe, reference, self._ended, self._answers))
        self._thread.start()

    def answered(self, since: float) -> list[float]:
        return [at for at in list(self._answers) if at > since]

    def end(self) -> None:
        self._ended.set()
        if self._thread is not None:
            self._thread.join()

    @staticmethod
    def _call(probe: Probe, reference: Any, ended: threading.Event, answers: list[float]) -> None:
        due = time.monotonic()
        while not ended.wait(max(0.0, due - time.monotonic())):
            with contextlib.suppress(CORBA.SystemException):
                probe.call(reference)
                answers.append(time.monotonic())
            due = max(due + INTERVAL_S, time.monotonic())


def main() -> None:
    with Orb(Address("127.0.0.1", 1)) as orb:
        caller = Caller(orb)
        try:
            answer_commands(caller.begin, caller.answered, caller.end)
        finally:
            caller.end()


if __name__ == "__main__":
    main()
