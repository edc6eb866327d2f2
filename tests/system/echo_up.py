"""robocorba up with the echo server in place of the real ones:
python echo_up.py STATE NAMING_HOST:PORT LIMIT_S HANG_LIMIT_S."""

from __future__ import annotations

import sys
from pathlib import Path

from robocorba.commands.up import run
from robocorba.errors.base import RoboCorbaError
from robocorba.stubs import RoboCorba
from robocorba.system.corba.servers import Probe, Server
from robocorba.system.settings import Address
from robocorba.system.state_folder import StateFolder
from robocorba.system.supervision.hangs import HangLimit
from robocorba.system.supervision.system import System

ECHO = Server(
    "echo", "echo_server", {"PathPlanner": Probe(RoboCorba.PathPlanner, lambda planner: planner._get_mapVersion())}
)

if __name__ == "__main__":
    state, naming = Path(sys.argv[1]).absolute(), Address.parse(sys.argv[2])
    limit_s, hang_limit_s = float(sys.argv[3]), float(sys.argv[4])
    try:
        run(System(StateFolder(state), naming, [ECHO], start_limit_s=limit_s, hang_limit=HangLimit(hang_limit_s)))
    except RoboCorbaError as error:
        sys.exit(f"robocorba up: {error}")
