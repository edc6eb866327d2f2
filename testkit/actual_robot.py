"""A robot's own naming service and a servers/smartpal process bound in it, as real processes."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from subprocess import Popen
from typing import Any, NamedTuple

from robocorba.errors.services import NotReachable
from robocorba.orb.orb import Orb
from robocorba.stubs import RoboCorba
from robocorba.system.claimed_ports import claimed_ports
from robocorba.system.settings import Address
from robocorba.system.supervision.launch import module_command
from robocorba.system.supervision.system import naming_service_command
from testkit.processes import Launcher, drain, eventually

#: Time limit for the start on a busy machine [s].
START_LIMIT_S = 300.0
ROOT = Path(__file__).resolve().parents[1]


class StandIn(NamedTuple):
    """naming: of the robot itself. process: the stand-in. orb: of this process, for another naming service."""

    naming: Address
    process: Popen[str]
    orb: Orb

    @property
    def faults(self) -> Any:
        """The stand-in's SmartPalFaults."""
        return self.orb.resolve_in_other_naming_service(self.naming, "Faults", RoboCorba.SmartPalFaults, 30.0)

    def unit(self, name: str, interface: Any) -> Any:
        return self.orb.resolve_in_other_naming_service(self.naming, name, interface, 30.0)


@contextlib.contextmanager
def running_stand_in(
    folder: Path, *arguments: str, orb: Orb | None = None, host: str = "127.0.0.1", within: Sequence[str] = ()
) -> Iterator[StandIn]:
    """Both processes, ready, until the end of the `with`. orb: of this process if it already has one. within: command
    prefix that runs them on another `host`."""
    folder.mkdir(exist_ok=True)
    with claimed_ports() as port, Launcher(folder) as launch:
        naming = Address(host, port)
        names = folder / "names"
        names.mkdir(exist_ok=True)
        launch(*within, *naming_service_command(naming, names))
        process = launch(
            *(*within, *module_command("robocorba.servers.smartpal"), "--state", str(folder / "state")),
            *("--endpoint", f"{host}:{port + 1}", "--naming", str(naming), *arguments),
            PYTHONPATH=str(ROOT),
        )
        with contextlib.nullcontext(orb) if orb else Orb(Address("127.0.0.1", port + 2)) as ours:
            place = StandIn(naming, process, ours)
            eventually(lambda: _is_ready(place), START_LIMIT_S, "the stand-in")
            drain(process)
            yield place


def _is_ready(place: StandIn) -> bool:
    assert place.process.poll() is None, place.process.communicate()[1]
    try:
        place.faults.none()
    except NotReachable:
        return False
    return True
