"""What a robot client composes: the check of programs."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace
from typing import Any, cast
from unittest.mock import MagicMock

import numpy as np

from robocorba.clients.robot import Checker
from robocorba.errors.services import NotReachable
from robocorba.map_editor.spatial.pose import Pose
from robocorba.planning.request import Path, PathRequest
from robocorba.robot.kinematics.smartpal import JOINTS
from robocorba.robot.programs.icons import (
    Branch,
    CloserThan,
    FartherThan,
    MbasePath,
    Repeat,
    Say,
    StopIfCloser,
    WaitUntil,
)
from robocorba.robot.programs.program import Program
from robocorba.robot.senses import RangeSensor, usual_sensors
from robocorba.simulation.sensing.fan import Fan
from robocorba.simulation.sensing.scan import Mount, ScanSpec

PATIENCE_S = 120.0
JOINTS_AT_ZERO = SimpleNamespace(joints=np.zeros(len(JOINTS)))
STATE = cast(Any, SimpleNamespace(at=Pose("L1", 1.0, 1.0, 0.0), actor=JOINTS_AT_ZERO, adaptor="corba"))


class HangingPlanner:
    """Answers no request until `released`."""

    def __init__(self) -> None:
        self.is_asked, self.released = threading.Event(), threading.Event()

    def paths(self, request: PathRequest) -> list[Path]:
        self.is_asked.set()
        self.released.wait(PATIENCE_S)
        raise NotReachable("the path planning agent does not answer")


def test_a_check_does_not_wait_for_the_planner_of_another() -> None:
    planner = HangingPlanner()
    checker = Checker(planner)
    with ThreadPoolExecutor(2) as pool:
        try:
            hanging = pool.submit(checker, Program(name="path", icons=(MbasePath("L1", 3.0, 1.0),)), STATE)
            assert planner.is_asked.wait(PATIENCE_S)
            assert pool.submit(checker, Program(name="hello", icons=(Say("hello"),)), STATE).result(PATIENCE_S).is_valid
            assert not hanging.done()
        finally:
            planner.released.set()


def test_a_program_that_senses_is_refused_without_the_sensor() -> None:
    """Also in a branch and a condition; never with the virtual sensor in its place."""
    inside = Branch(CloserThan("front", 0.5), (StopIfCloser("laser", 0.5, (Say("hello"),)),))
    wanted = Program(name="watch", icons=(Repeat(2, (inside,)), WaitUntil(FartherThan("back", 0.5), 1.0)))
    checker = Checker(HangingPlanner())

    def findings(*sensors: RangeSensor) -> dict[str, str]:
        senses = MagicMock(sensors=sensors) if sensors else None
        report = checker(wanted, STATE, senses=senses)
        return {f"{found.icon}.{found.parameter}": found.reason for found in report.findings}

    lacking = "the adaptor corba has no sensor {}; it has {}".format
    assert findings() == {
        "icons[0].icons[0].condition.sensor": lacking("front", "no sensors"),
        "icons[0].icons[0].then[0].sensor": lacking("laser", "no sensors"),
        "icons[1].condition.sensor": lacking("back", "no sensors"),
    }
    laser, ring = usual_sensors()
    assert findings(laser, ring) == {}
    short = RangeSensor("laser", Mount(), ScanSpec(Fan(0.0, 0.1, 9, 0.4)))
    ahead = RangeSensor("proximity", Mount(), ScanSpec(Fan(0.0, 0.1, 1, 1.0)))
    assert findings(short, ahead) == {
        "icons[0].icons[0].then[0].distance": "0.5 m is beyond the range of laser, 0.4 m",
        "icons[1].condition.sensor": lacking("back", "laser, proximity, front"),
    }
