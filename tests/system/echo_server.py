"""A small real CORBA server for tests of what surrounds servers: a PathPlanner whose map version is its process id,
and which knows no floor, so that its getPath sends the start's floor back.

ECHO_MODE makes it misbehave: broken (fails at start), mute (starts, but never serves), slow (half a second
from listening to serving), stubborn (does not end on SIGTERM), parent (has a child, which ignores SIGTERM).
"""

from __future__ import annotations

import logging
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from typing import Any, NoReturn

from robocorba.orb.orb import Orb
from robocorba.stubs import RoboCorba, RoboCorba__POA
from robocorba.system import logs
from robocorba.system.settings import ServerSettings


class EchoPlanner(RoboCorba__POA.PathPlanner):
    def _get_mapVersion(self) -> int:
        return os.getpid()

    def getPath(self, start: Any, goal: Any) -> NoReturn:
        raise RoboCorba.UnknownFloor("start", start.floor, [])


def main(arguments: Sequence[str] | None = None) -> None:
    settings = ServerSettings.read(arguments)
    logs.setup("echo", settings.state / "logs")
    mode = os.environ.get("ECHO_MODE", "")
    if mode == "broken":
        raise ValueError("the echo is broken\non two lines")
    if mode == "parent":
        ignoring = "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN); time.sleep(600)"
        subprocess.Popen([sys.executable, "-c", ignoring])
    with Orb(naming=settings.naming, endpoint=settings.endpoint) as orb:
        logging.info("listening on %s", settings.endpoint)
        if mode == "slow":
            time.sleep(0.5)
        if mode != "mute":
            orb.serve({"PathPlanner": EchoPlanner()})
        orb.run()
        if mode == "stubborn":
            signal.signal(signal.SIGTERM, signal.SIG_IGN)
            time.sleep(600)


if __name__ == "__main__":
    main()
