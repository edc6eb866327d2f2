"""A process of testkit.ros2_robot, and what an agent needs to find it."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import ClassVar

from testkit.processes import Launcher
from testkit.ros2_environment import python_path


class Disc:
    """The robot, with arguments. ADAPTOR: that of its agent; environment: in which the agent runs, by the same Python;
    where: its poses so far by its own odometry [m, rad]."""

    ADAPTOR: ClassVar = ("ros2", "--scan", "scan@0.1,0,0", "--namespace", "/")

    def __init__(self, launch: Launcher, python: str, folder: Path, domain: int, *arguments: str) -> None:
        self.environment = {"PYTHONPATH": python_path(), "ROS_LOG_DIR": str(folder), "ROS_DOMAIN_ID": str(domain)}
        self.environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
        self.process = launch(python, "-m", "testkit.ros2_robot", *arguments, **self.environment)
        self.where = [(0.0, 0.0, 0.0)]
        threading.Thread(target=self._follow, daemon=True).start()

    def _follow(self) -> None:
        for line in self.process.stdout or ():
            x, y, heading = map(float, line.split("\t"))
            self.where.append((x, y, heading))
