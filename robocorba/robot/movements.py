"""Runs a robot's motions one after the other; other threads can interrupt them."""

from __future__ import annotations

from collections.abc import Callable

from robocorba.robot.execution_control import CHECK_INTERVAL_S, ExecutionControl
from robocorba.robot.high_controller import HighController
from robocorba.robot.motion.motion import Motion
from robocorba.robot.session import BuildingSession


class Movements:
    """Base class for the movements of a robot's parts. One thread at a time moves the robot; any thread may use
    `execution`."""

    def __init__(
        self, controller: HighController, session: BuildingSession, check_interval_s: float = CHECK_INTERVAL_S
    ) -> None:
        self.controller, self.session = controller, session
        self.execution = ExecutionControl(controller.cancel, self._hold, check_interval_s)

    def move(self, motion: Motion) -> None:
        """Run a motion to its end."""
        self.execution.check()
        self.controller.move(motion)

    def wait(self, seconds: float, is_met: Callable[[], bool] = lambda: False) -> bool:
        """Wait for some time [s, robot's clock] or until a condition is met; returns whether it is."""

        def check() -> bool:
            self.controller.check()  # the clock of a robot that is stopped does not advance
            return is_met()

        return self.execution.wait_for(check, seconds, self.clock)

    def clock(self) -> float:
        """The robot's time [s]."""
        return self.controller.state.time

    def _hold(self, is_held: bool) -> None:
        self.controller.is_paused = is_held
