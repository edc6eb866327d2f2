"""robocorba console: the operator's console in the browser."""

from __future__ import annotations

import os

import typer

from robocorba.commands.reporting import reporting
from robocorba.system.extras import require_extra
from robocorba.system.supervision.launch import module_command


def console(context: typer.Context) -> None:
    """Serve the operator's console: [--host H] [--port N] [--password-file FILE] [--certificate FILE --key FILE]
    [--administrator FILE] [--supervisor FILE] [--recording FILE] [--viewers N] [--pin-file FILE] [--programs DIR]
    [--naming HOST:PORT] [--state DIR].

    It prints its address, and serves until Ctrl-C or SIGTERM. `--help` lists the options."""
    with reporting("console"):
        require_extra("console", "pages of the console")
    command = module_command("robocorba.clients.console", *context.args)
    os.execv(command[0], command)
