"""The operator's console as a process of a system."""

from __future__ import annotations

from pathlib import Path

from robocorba.names import ADMINISTRATOR, SUPERVISOR
from robocorba.settings import Address
from robocorba.supervision.launch import ModuleRun
from robocorba.supervision.output import ReadyLine
from robocorba.supervision.process import ProcessSpec

CONSOLE = "console"


def console_spec(address: Address, state: Path, naming: Address, start_limit_s: float) -> ProcessSpec:
    """The console at a loopback address, with the rights of the administrator and to start robots."""
    options = ["--host", address.host, "--port", str(address.port), "--naming", naming.setting, "--state", str(state)]
    options += ["--administrator", str(state / ADMINISTRATOR), "--supervisor", str(state / SUPERVISOR)]
    command = ModuleRun("robocorba.clients.console", tuple(options))
    output = ReadyLine(CONSOLE, ignored="http")
    return ProcessSpec(CONSOLE, command, state, output.probe, output, start_limit_s, endpoint=str(address))
