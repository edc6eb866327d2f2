"""What a robot client composes: the check of programs."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace
from typing import Any, cast

import numpy as np

from robocorba.clients.robot import Checker
from robocorba.errors.services import NotReachable
from robocorba.map_editor.spatial.pose import Pose
from robocorba.planning.request import Path, PathRequest
from robocorba.robot.kinematics.smartpal import JOINTS
from robocorba.robot.programs.icons import MbasePath, Say
from robocorba.robot.programs.program import Program

PATIENCE_S = 60.0
STATE = cast(Any, SimpleNamespace(at=Pose("L1", 1.0, 1.0, 0.0), actor=SimpleNamespace(joints=np.zeros(len(JOINTS)))))


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
