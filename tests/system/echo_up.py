"""robocorba up with the echo server in place of the real ones:
python -m tests.system.echo_up STATE NAMING_HOST:PORT LIMIT_S HANG_LIMIT_S."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from robocorba.commands.up import run
from robocorba.errors.base import RoboCorbaError
from robocorba.stubs import RoboCorba
from robocorba.system.corba.servers import Probe, Server
from robocorba.system.settings import Address
from robocorba.system.state_folder import StateFolder
from robocorba.system.supervision import warm_parent
from robocorba.system.supervision.hangs import HangLimit
from robocorba.system.supervision.system import System
from testkit.forked_system import fork_warm_parent

MODULE = "tests.system.echo_server"
PROBE = Probe(RoboCorba.PathPlanner, lambda planner: planner._get_mapVersion())


def preload() -> None:
    """Load the server."""
    warm_parent.load(MODULE)


def main(arguments: Sequence[str]) -> None:
    """Run it in a fork: its warm parent is one, too."""
    fork_warm_parent()
    up(*arguments)


def up(state: str, naming: str, limit_s: str, hang_limit_s: str) -> None:
    folder, echo = StateFolder(Path(state).absolute()), Server("echo", MODULE, {"PathPlanner": PROBE})
    limits = {"start_limit_s": float(limit_s), "hang_limit": HangLimit(float(hang_limit_s))}
    try:
        run(System(folder, Address.parse(naming), [echo], **limits))  # type: ignore[arg-type]
    except RoboCorbaError as error:
        sys.exit(f"robocorba up: {error}")


if __name__ == "__main__":
    up(*sys.argv[1:])
