"""The pages of docs/ for more than one machine, followed as their reader does."""

from __future__ import annotations

from pathlib import Path

import pytest

from robocorba.claimed_ports import claimed_ports
from robocorba.testing.actual_robot import running_stand_in
from robocorba.testing.namespaces import Namespace
from tests.system.tutorial import TUTORIALS, Reader

pytestmark = [pytest.mark.system, pytest.mark.slow]


def test_two_machines(tmp_path: Path) -> None:
    try:
        one, two = Namespace(), Namespace()
    except OSError as error:
        pytest.skip(f"needs network namespaces: {error}")
    with one, two:
        one.ip("link", "add", "eth0", "type", "veth", "peer", "name", "eth0", "netns", two.path)
        for number, machine in enumerate((one, two), 1):
            machine.ip("address", "add", f"10.60.0.{number}/24", "dev", "eth0")
            machine.ip("link", "set", "eth0", "up")
        terminals = {"one": one.command(), "listener": one.command(), "two": two.command()}
        with Reader(TUTORIALS / "two-machines.md", tmp_path, {}, terminals) as reader:
            reader.follow()


def test_a_real_smartpal(tmp_path: Path) -> None:
    """The stand-in is the robot."""
    with running_stand_in(tmp_path / "robot") as robot, claimed_ports() as port:
        options = {"192.168.4.211:5005": str(robot.naming)}
        (tmp_path / "reader").mkdir()
        environment = {"ROBOCORBA_NAMING": f"127.0.0.1:{port}"}
        page = TUTORIALS.parent / "real-smartpal.md"
        with Reader(page, tmp_path / "reader", environment, options=options) as reader:
            reader.follow()
