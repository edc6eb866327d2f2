"""The stand-in for an actual robot as processes: its own naming service, and servers/smartpal bound there."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from subprocess import Popen
from typing import Any, NamedTuple

from robocorba.corba.orb import Orb
from robocorba.errors.services import NotReachable
from robocorba.settings import Address
from robocorba.stubs import RoboCorba
from robocorba.supervision.launch import module_command
from robocorba.supervision.system import naming_service_command
from robocorba.testing.processes import Launcher, claimed_ports, eventually

ROOT = Path(__file__).resolve().parents[2]


class StandIn(NamedTuple):
    """naming: the robot's own naming service. process: servers/smartpal. orb: of this process."""

    naming: Address
    process: Popen[str]
    orb: Orb

    @property
    def faults(self) -> Any:
        """Its SmartPalFaults."""
        return self.orb.resolve_in_other_naming_service(self.naming, "Faults", RoboCorba.SmartPalFaults, 2.0)

    def unit(self, name: str, interface: Any) -> Any:
        return self.orb.resolve_in_other_naming_service(self.naming, name, interface, 2.0)


@contextlib.contextmanager
def running_stand_in(folder: Path, *arguments: str, orb: Orb | None = None) -> Iterator[StandIn]:
    """Run both processes; ready at the start of the `with`. orb: of this process if it already has one."""
    with claimed_ports() as port, Launcher(folder) as launch:
        naming = Address("127.0.0.1", port)
        names = folder / "names"
        names.mkdir(exist_ok=True)
        launch(*naming_service_command(naming, names))
        process = launch(
            *(*module_command("robocorba.servers.smartpal"), "--state", str(folder / "state")),
            *("--endpoint", f"127.0.0.1:{port + 1}", "--naming", str(naming), *arguments),
            PYTHONPATH=str(ROOT),
        )
        with contextlib.nullcontext(orb) if orb else Orb(Address("127.0.0.1", port + 2)) as ours:
            robot = StandIn(naming, process, ours)
            eventually(lambda: _is_ready(robot), 60.0, "the stand-in")
            yield robot


def _is_ready(robot: StandIn) -> bool:
    assert robot.process.poll() is None, robot.process.communicate()[1]
    try:
        robot.faults.none()
    except NotReachable:
        return False
    return True
