"""A server that nobody attacks. How long its calls take is what the machine needs, with all that runs on it.

    python -m bench.chaos.untouched

It prints its reference as JSON, and ends with its stdin."""

from __future__ import annotations

from typing import Any

from robocorba.orb.orb import Orb
from robocorba.stubs import RoboCorba, RoboCorba__POA
from robocorba.system.claimed_ports import claimed_ports
from robocorba.system.settings import Address
from testkit.json_process import answer_lines


class Untouched(RoboCorba__POA.VirtualSensor):
    """A sensor without a load."""

    def _get_load(self) -> Any:
        return RoboCorba.SensorLoad(0.0, 0.0, 0.0, 0)


def main() -> None:
    with claimed_ports() as port, Orb(Address("127.0.0.1", port), Address("127.0.0.1", port + 1)) as orb:
        reference = orb.activate(Untouched())
        orb.accept_calls()
        answer_lines(lambda _: None, orb.uri(reference))


if __name__ == "__main__":
    main()
