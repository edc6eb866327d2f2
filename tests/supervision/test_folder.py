"""The record of a system in its state folder."""

from __future__ import annotations

from robocorba.supervision.console import CONSOLE
from robocorba.supervision.folder import ProcessRecord, SystemRecord


def record(*names: str) -> SystemRecord:
    processes = [
        ProcessRecord(name, "running", 7, f"127.0.0.1:{port}", (), 0.0, 0) for port, name in enumerate(names, 9001)
    ]
    return SystemRecord("127.0.0.1:2809", 1, 0.0, tuple(processes))


def test_the_address_of_the_console() -> None:
    assert record("simulation", CONSOLE, "robot_R1").console_address == "http://127.0.0.1:9002/"
    assert record("simulation", "robot_console").console_address == ""
