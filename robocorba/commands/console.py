"""robocorba console: the operator's console in the browser."""

from __future__ import annotations

from robocorba.commands.forwarding import forwarding
from robocorba.commands.reporting import reporting
from robocorba.console.settings import ConsoleSettings
from robocorba.system.extras import require_extra


@forwarding("robocorba.clients.console", ConsoleSettings.add_arguments)
def console() -> None:
    """Serve the operator's console to browsers and print its address. Ctrl-C or SIGTERM ends it."""
    with reporting("console"):
        require_extra("console", "pages of the console")
