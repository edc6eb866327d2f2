"""The operator's console: a web server that shows and steers the running system."""

from __future__ import annotations

import signal

if __name__ == "__main__":  # Ctrl-C while modules are loaded ends the process without a traceback
    signal.signal(signal.SIGINT, signal.SIG_DFL)

from collections.abc import Sequence

from robocorba.clients.cooperative_planners import planner_of
from robocorba.console.server import Console, serve
from robocorba.console.settings import ConsoleSettings
from robocorba.errors.base import RoboCorbaError
from robocorba.orb.orb import Orb
from robocorba.system import logs
from robocorba.system.printing import fail
from robocorba.system.private_files import claim_state


def main(arguments: Sequence[str] | None = None) -> None:
    try:
        settings = ConsoleSettings.read(arguments, __doc__ or "")
        claim_state(settings.common.state)
        logs.setup("console", settings.common.state / "logs")
        with Orb(settings.common.naming) as orb:
            serve(Console(orb, settings, planner_of), settings)
    except RoboCorbaError as error:
        fail(f"robocorba console: {error}")


if __name__ == "__main__":
    main()
