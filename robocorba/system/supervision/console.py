"""The operator's console as a process of a system."""

from __future__ import annotations

from pathlib import Path

from robocorba.system.names import ADMINISTRATOR, CONSOLE, SUPERVISOR
from robocorba.system.settings import Address
from robocorba.system.supervision.launch import ModuleRun
from robocorba.system.supervision.output import ReadyLine
from robocorba.system.supervision.process import ProcessSpec


def console_spec(address: Address, state: Path, naming: Address, start_limit_s: float) -> ProcessSpec:
    """The console at a loopback address, with the rights of the administrator and to start robots."""
    options = ["--host", address.host, "--port", str(address.port), "--naming", naming.setting, "--state", str(state)]
    options += ["--administrator", str(state / ADMINISTRATOR), "--supervisor", str(state / SUPERVISOR)]
    command = ModuleRun("robocorba.clients.console", tuple(options))
    output = ReadyLine(CONSOLE, ignored="http")
    return ProcessSpec(CONSOLE, command, state, output.probe, output, start_limit_s, endpoint=str(address))
