"""The objects of a guarded process as single robots call them, each by its own file (`robocorba access robot`)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from robocorba.orb.guard import Guard, guarded_for
from robocorba.system.repeating import Repeating
from robocorba.system.settings import robot_keys

#: Interval between looks at the files of robots [s].
CHECK_INTERVAL_S = 0.5


class RobotObjects:
    """Follows the files in `access` (the folder of the roles' files): a new robot may call at once, one whose file was
    removed no longer. activate, deactivate: of the process's ORB, with an object key."""

    def __init__(
        self,
        access: Path,
        guard: Guard,
        servants: Mapping[str, Any],
        activate: Callable[[Any, str], Any],
        deactivate: Callable[[str], None],
    ) -> None:
        self._access, self._guard, self._servants = access, guard, servants
        self._activate, self._deactivate = activate, deactivate
        #: The file's key of each robot.
        self._robots: dict[str, str] = {}
        self._check = Repeating("robots' files", self._follow, CHECK_INTERVAL_S)

    def start(self) -> RobotObjects:
        """Activate the objects of the robots that there are, then follow."""
        self._follow()
        self._check.start()
        return self

    def close(self) -> None:
        self._check.close()

    def _follow(self) -> None:
        robots = robot_keys(self._access)
        for _, key in self._robots.items() - robots.items():
            for name in self._servants:
                self._deactivate(self._guard.robot_key(name, key))
        for robot, key in robots.items() - self._robots.items():
            for name, servant in self._servants.items():
                self._activate(guarded_for(servant, robot), self._guard.robot_key(name, key))
        self._robots = robots
